"""`benchmarks.identity` reports a changed result, and nothing else."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from benchmarks import identity
from benchmarks.identity import TOLERANCE, differences, file_content, main

CASES = ["--parts", "commands", "--cases", "commands/metric-tree_list_--*"]
LISTED = "commands/metric-tree_list_--json"


@pytest.fixture(scope="module")
def entries_file(tmp_path_factory):
    file = tmp_path_factory.mktemp("identity") / "before.json"
    assert main([*CASES, "--out", str(file)]) == 0
    return file


def test_a_second_run_of_one_version_is_equal(entries_file, capsys):
    assert main([*CASES, "--against", str(entries_file)]) == 0
    assert "0 results differ, 0 differ in wording" in capsys.readouterr().out


def test_a_planted_difference_is_reported_with_both_values(entries_file, tmp_path, capsys):
    report = json.loads(entries_file.read_text())
    status = report["cases"][LISTED][f"{LISTED}:status"]
    status |= {"value": 7, "digest": "0"}
    planted = tmp_path / "planted.json"
    planted.write_text(json.dumps(report))
    assert main([*CASES, "--against", str(planted)]) == 1
    out = capsys.readouterr().out
    assert f"result: {LISTED}:status\n    -7\n    +0\n" in out
    assert "1 results differ, 0 differ in wording" in out


def test_a_case_that_is_missing_after_the_change_is_reported(entries_file, tmp_path, capsys):
    report = json.loads(entries_file.read_text())
    report["cases"]["commands/metric-tree_list_--more"] = {}
    planted = tmp_path / "planted.json"
    planted.write_text(json.dumps(report))
    assert main([*CASES, "--against", str(planted)]) == 1
    assert "commands/metric-tree_list_--more: only before" in capsys.readouterr().out


@pytest.mark.parametrize(("factor", "reported"), [(0.9, 0), (1.1, 1)])
def test_near_numbers_may_differ_by_the_tolerance(factor, reported):
    before, after = ({"m": {"kind": "near", "value": {"x": [1.0, v]}}} for v in (2.0, 2.0 * (1 - factor * TOLERANCE)))
    assert len(list(differences(before, after))) == reported
    assert len(list(differences(before, {"m": {"kind": "near", "value": {"x": [1.0]}}}))) == 1


def test_seconds_are_no_difference():
    entries = [identity._entry("result", [{"scale": 1.5, "seconds": seconds}])["digest"] for seconds in (1, 2)]
    assert entries[0] == entries[1] != identity._entry("result", [{"scale": 1.6, "seconds": 1}])["digest"]


def test_a_sentence_in_a_result_is_wording_and_a_code_is_not():
    before, sentence, code = (
        {"m": identity._entry("result", {"reason": reason, "notes": [note]})}
        for reason, note in (
            ("flat", "seen by one view"),
            ("flat", "only one view sees it"),
            ("round", "seen by one view"),
        )
    )
    assert [kind for _, kind, _ in differences(before, sentence)] == ["wording"]
    assert [kind for _, kind, _ in differences(before, code)] == ["result"]


def test_an_image_is_compared_by_its_pixels(tmp_path):
    def content(pixels, comment):
        info = PngImagePlugin.PngInfo()
        info.add_text("Software", comment)
        data = io.BytesIO()
        Image.fromarray(pixels).save(data, "PNG", pnginfo=info)
        return file_content(tmp_path / "a.png", data.getvalue())

    black, other = np.zeros((4, 5, 3), np.uint8), np.zeros((4, 5, 3), np.uint8)
    other[3, 4, 2] = 1
    assert content(black, "one") == content(black, "two") != content(other, "one")
