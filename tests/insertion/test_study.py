"""The user study: the page holds its pictures, the report finds the observer that answered."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from insertion.study.answers import ANSWERS, Answer, read_answers
from insertion.study.curve import Observer, curve_of, wilson
from insertion.study.page import ANSWERS_SCHEMA, STEPS, study_page
from insertion.study_command import run_study
from metric_base.faults import InputFault


def _answers(observer: Observer, participants: int, repeats: int, seed: int) -> list[Answer]:
    generator = np.random.default_rng(seed)
    shares = observer.shares(np.array(STEPS, dtype=float))
    return [
        Answer(str(person), float(step), ANSWERS[generator.choice(3, p=share)])
        for person in range(participants)
        for _ in range(repeats)
        for step, share in zip(STEPS, shares, strict=True)
    ]


def test_the_observer_is_found_again() -> None:
    true = Observer(bias=0.05, sigma=0.15, criterion=0.12)
    curve = curve_of(_answers(true, 12, 4, 1))
    assert not curve.flat
    assert curve.observer.peak == pytest.approx(true.peak, abs=3.0)
    assert curve.observer.noticeable == pytest.approx(true.noticeable, rel=0.2)
    assert curve.noticeable_interval is not None
    low, high = curve.noticeable_interval
    assert low < true.noticeable < high


def test_answers_by_chance_are_a_flat_curve() -> None:
    generator = np.random.default_rng(2)
    answers = [Answer(str(k % 2), float(step), str(generator.choice(ANSWERS))) for k in range(6) for step in STEPS]
    assert curve_of(answers).flat


@given(st.integers(1, 300), st.data())
def test_an_interval_holds_its_share(count: int, data: st.DataObject) -> None:
    right = data.draw(st.integers(0, count))
    low, high = wilson(right, count)
    assert 0 <= low <= right / count + 1e-12
    assert right / count - 1e-12 <= high <= 1


def test_the_page_needs_no_network() -> None:
    pictures = {step: np.full((8, 8, 3), 100 + step, np.uint8) for step in STEPS}
    page = study_page(pictures, "<!--<script></script> how large", "chair", 2)
    assert not re.search(r"(?:src|href)\s*=\s*[\"']?https?:", page)
    study = json.loads(page.split("const study = ")[1].split(";\n")[0].replace("<\\/", "</"))
    assert [picture["step"] for picture in study["pictures"]] == sorted(STEPS)
    assert page.count("</script>") == page.count("<script") == 1
    assert study["title"] == "<!--<script></script> how large"


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ({"schema": "other"}, "schema"),
        ({"schema": ANSWERS_SCHEMA, "answers": 3}, "answers"),
        ({"schema": ANSWERS_SCHEMA, "answers": [{"step": "5", "answer": "right"}]}, r"answers\[0\].step"),
        ({"schema": ANSWERS_SCHEMA, "answers": [{"step": 5, "answer": "fine"}]}, r"answers\[0\].answer"),
        ({"schema": ANSWERS_SCHEMA, "answers": []}, "at least one"),
    ],
)
def test_bad_answers_are_named(tmp_path: Path, document: dict, words: str) -> None:
    file = tmp_path / "answers.json"
    file.write_text(json.dumps(document))
    with pytest.raises(InputFault, match=words):
        read_answers(file)


def test_the_report_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for person in range(3):
        rows = [
            {"step": answer.step, "answer": answer.answer} for answer in _answers(Observer(0, 0.1, 0.1), 1, 3, person)
        ]
        record = {"schema": ANSWERS_SCHEMA, "participant": f"p{person}", "answers": rows}
        (tmp_path / f"{person}.json").write_text(json.dumps(record))
    figure = tmp_path / "curve.png"
    assert run_study(["report", str(tmp_path), "--figure", str(figure)]) == 0
    assert "just-noticeable step" in capsys.readouterr().out
    assert figure.stat().st_size > 5000
