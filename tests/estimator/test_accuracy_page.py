"""The report of accuracy: its statistics against hand-made outcomes, and a page without a hole."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy.__main__ import TEMPLATE
from benchmarks.accuracy.methods import METHODS
from benchmarks.accuracy.outcomes import (
    Outcome,
    difference,
    interval_scores,
    read_outcomes,
    summary,
    write_outcomes,
)
from benchmarks.accuracy.page import Facts, page

ONE = Outcome(
    "methods", "rooms", "a", "default", np.log(1.1), False, np.log(0.95), np.log(1.2), 0.1, 6, np.log(1.08), 0.2
)


def test_summary_counts_answered_scenes_alone() -> None:
    outside = replace(ONE, scene="b", error=np.log(1.3), low=np.log(1.1), high=np.log(1.5), heights=0.3)
    refused = replace(ONE, scene="c", error=np.log(3.0), refused=True, low=np.nan, high=np.nan, heights=np.nan)
    s = summary([ONE, outside, refused])
    assert (s.n, s.coverage) == (3, 0.5)
    assert s.refused == pytest.approx(1 / 3)
    assert s.mean == pytest.approx(0.2)
    assert s.heights == pytest.approx(0.2)


def test_differences_are_of_the_scenes_of_both() -> None:
    ours = [replace(ONE, scene=str(k), error=np.log(1.05)) for k in range(12)]
    theirs = [replace(one, method="paper", error=np.log(1.15)) for one in ours[:10]]
    mean, low, high, count = difference(ours, theirs)
    assert count == 10
    assert mean == pytest.approx(-0.1)
    assert low <= mean <= high < 0


def test_an_interval_score_is_the_width_and_twenty_times_the_miss() -> None:
    missed = replace(ONE, median=0.2, low=0.1, high=0.3)
    assert interval_scores([ONE, missed]) == pytest.approx([np.log(1.2 / 0.95), 0.2 + 20 * 0.1])
    assert interval_scores([missed], 2.0) == pytest.approx([0.4])


def test_the_calibration_of_a_uniform_pit() -> None:
    uniform = [replace(ONE, scene=str(n), pit=(n + 0.5) / 40, median=0.0, low=-0.1, high=0.1) for n in range(40)]
    facts = Facts("", (), "", "", 0.0)
    text = page([replace(one, part="scenes") for one in uniform] + uniform, facts, "$calibration")
    for name in ("real scenes", "rooms"):
        assert f"| {name} | 40 | 0.50 | 0.80 | 0.90 | 0.95 | 0.20 | 25, 25, 25, 25 | 0.40 |" in text


def test_the_page_has_every_table(tmp_path: Path) -> None:
    parts = {
        "methods": "rooms",
        "structured": "3/6%",
        "sameness": "3/1/60%",
        "errors": "truncated: 0%",
    }
    outcomes = [
        replace(ONE, part=part, group=group, scene=str(number), method=method)
        for part, group in parts.items()
        for number in range(3)
        for method in METHODS
    ]
    write_outcomes(outcomes, tmp_path / "rows.jsonl")
    facts = Facts(
        command="python -m benchmarks.accuracy",
        earlier=("errors",),
        release="2.0.0",
        rooms="typical sizes",
        minutes=3.0,
    )
    text = page(read_outcomes(tmp_path / "rows.jsonl"), facts, TEMPLATE.read_text(encoding="utf-8"))
    assert "$" not in text
    assert text.count("Not run.") == 3  # no room or street of an unseen source
    assert re.search(r"\| rooms \| default \| 3 \| 0 \| 10\.0 \|", text)
