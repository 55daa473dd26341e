"""Parts, judging and tables of the benchmark of real footage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks.estimator.footage_cases import (
    FootageCase,
    Reference,
    made_cases,
    make_input,
    part_cases,
    read_reference,
)
from benchmarks.estimator.footage_judging import (
    GATES,
    MAX_PATH_ERROR,
    Row,
    conditions,
    gate_table,
    gates_of,
    judged,
    placed_right,
    summary_rows,
    table,
)
from benchmarks.estimator.footage_rows import ROWS, read_rows, updated_rows, write_rows
from benchmarks.estimator.real_footage import AGAINST_PAGE, main
from capture.mapping.refusals import MAX_CONTRADICTED_RATIO, MAX_FOCAL_STD, MIN_BROKEN_FRAMES, MIN_ZOOM
from metric_base.arrays import FloatArray


def _set(folder: Path, n: int, size: tuple[int, int] = (40, 30)) -> FootageCase:
    """A set of n images with a reference folder."""
    (folder / "images").mkdir(parents=True)
    (folder / "sparse").mkdir()
    for index in range(n):
        image = np.full((size[1], size[0], 3), index, dtype=np.uint8)
        cv2.imwrite(str(folder / "images" / f"{index:03d}.png"), image)
    return FootageCase(folder.name, "set", folder)


def _cuts(case: FootageCase) -> dict[str, tuple[str, ...]]:
    return {part.name.partition(", ")[2]: part.names for part in part_cases([case])}


def test_a_short_set_is_cut_into_halves_and_thinned_out(tmp_path: Path) -> None:
    cuts = _cuts(_set(tmp_path / "desk", 9))
    assert list(cuts) == ["first half", "second half", "every second"]
    assert cuts["first half"] == tuple(f"{k:03d}.png" for k in range(5))
    assert cuts["second half"] == tuple(f"{k:03d}.png" for k in range(5, 9))
    assert cuts["every second"] == tuple(f"{k:03d}.png" for k in range(0, 9, 2))


def test_a_walk_is_cut_into_windows_that_span_it(tmp_path: Path) -> None:
    cuts = _cuts(_set(tmp_path / "snow_walk", 118))
    assert list(cuts) == [*(f"30 from {start}" for start in (0, 17, 35, 52, 70, 88)), "re-encoded"]
    assert {len(names) for part, names in cuts.items() if part != "re-encoded"} == {30}
    assert cuts["30 from 88"][-1] == "117.png"
    assert len(cuts["re-encoded"]) == 118


@pytest.mark.parametrize(("n", "is_walk", "is_thinned"), [(89, False, True), (90, True, True), (101, True, False)])
def test_the_rule_of_the_parts_has_two_limits(tmp_path: Path, n: int, is_walk: bool, is_thinned: bool) -> None:
    cuts = _cuts(_set(tmp_path / "desk", n))
    assert ("30 from 0" in cuts) == is_walk
    assert ("first half" in cuts) != is_walk
    assert ("every second" in cuts) == is_thinned


def test_a_set_without_a_reference_has_no_parts(tmp_path: Path) -> None:
    case = _set(tmp_path / "desk", 9)
    (tmp_path / "desk" / "sparse").rmdir()
    assert not list(part_cases([case]))


def test_large_images_are_reduced_to_640_pixels_without_exif(tmp_path: Path) -> None:
    case = _set(tmp_path / "desk", 4, (800, 600))
    (part,) = (part for part in part_cases([case]) if part.change == "reduced")
    folder = make_input(part, tmp_path / "input")
    images = sorted(folder.iterdir())
    assert [image.name for image in images] == ["000.jpg", "001.jpg", "002.jpg", "003.jpg"]
    assert {np.asarray(cv2.imread(str(image))).shape for image in images} == {(480, 640, 3)}
    assert b"Exif" not in images[0].read_bytes()


def test_a_re_encoded_walk_has_all_frames_and_an_even_size(tmp_path: Path) -> None:
    case = _set(tmp_path / "snow_walk", 7, (65, 49))
    (part,) = (part for part in part_cases([case]) if part.change == "film")
    from capture.sources.video import Video

    film = Video(make_input(part, tmp_path / "input"))
    frames = list(film.frames())
    assert (film.width, film.height, len(frames)) == (64, 48, 7)
    assert [int(np.median(frame.colour)) for frame in frames] == pytest.approx(list(range(7)), abs=3)


def test_the_rendered_captures_are_split_once() -> None:
    groups = {name: [case for case in made_cases() if case.group == name] for name in ("choosing", "reported", "error")}
    assert [len(cases) for cases in groups.values()] == [10, 10, 18]
    kinds = {name: {case.name.partition("_")[0] for case in groups[name]} for name in ("choosing", "reported")}
    assert {"street", "aerial", "kitchen"} <= kinds["choosing"] & kinds["reported"]
    assert len({case.error for case in groups["error"]}) == 9
    assert {case.error for case in groups["error"] if case.unusable} == {"pure rotation", "tripod", "cut"}


def _path(n: int = 20) -> FloatArray:
    angle = np.linspace(0, 3, n)
    return np.column_stack([np.cos(angle), np.sin(angle), 0.1 * np.sin(5 * angle)])


def _similar(path: FloatArray) -> FloatArray:
    turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    return np.asarray(2.5 * path @ (turn * np.sign(np.linalg.det(turn))) + [1.0, 2.0, 3.0])


def test_images_off_the_path_do_not_spoil_the_others() -> None:
    path = _path()
    extent = float(np.sqrt(((path - path.mean(axis=0)) ** 2).sum(axis=1).mean()))
    assert placed_right(_similar(path), path, extent) == 20
    moved = path.copy()
    moved[12:] += [0.5, 0.4, 0.3]
    assert placed_right(_similar(moved), path, extent) == 12
    moved = path.copy()
    moved[0, 2] += 6 * MAX_PATH_ERROR * extent  # a similarity takes up a part of it
    assert placed_right(_similar(moved), path, extent) == 19
    assert placed_right(path[:3], path[:3], extent) == 0


def _result(path: FloatArray, **changes: Any) -> dict[str, Any]:
    centres = {f"{index:06d}.jpg": centre.tolist() for index, centre in enumerate(_similar(path))}
    figures = {"code": None, "frames": 20, "centres": centres, "focal": 0.8, "cpu_s": 30.0, "wall_s": 20.0}
    return figures | {"metrics": None} | changes


REFERENCE = Reference({f"{index:06d}": centre for index, centre in enumerate(_path())}, 0.8)
CASE = FootageCase("walk", "set", Path("walk"))


def test_a_model_is_right_within_three_hundredths_of_the_path() -> None:
    noise = np.random.default_rng(1).standard_normal((20, 3)) * 0.01
    right = judged(_result(_path() + noise), REFERENCE, CASE)
    assert right.is_right
    assert right.rms == pytest.approx(0.016, abs=0.01)
    wrong = judged(_result(_path() + 5 * noise), REFERENCE, CASE)
    assert wrong.is_right is False
    assert wrong.n_placed == 20
    assert (wrong.n_right or 0) < 20


def test_a_reference_of_some_frames_judges_these() -> None:
    some = Reference(dict(list(REFERENCE.centres.items())[:8]), 0.8)
    judgement = judged(_result(_path()), some, CASE)
    assert (judgement.n_placed, judgement.n_right, judgement.is_right) == (20, 8, True)


def test_three_images_are_no_test_of_a_path() -> None:
    assert judged(_result(_path()[:3]), REFERENCE, CASE).is_right is None
    assert judged(_result(_path()), None, CASE).n_right is None


@pytest.mark.parametrize(("focal", "is_right"), [(0.86, True), (0.9, False)])
def test_a_constructed_error_is_also_judged_by_its_focal_length(focal: float, is_right: bool) -> None:
    case = FootageCase("drive", "error", Path("drive"), error="straight drive")
    assert judged(_result(_path(), focal=focal), REFERENCE, case).is_right is is_right
    assert judged(_result(_path(), focal=focal), REFERENCE, CASE).is_right


def test_every_model_of_an_unusable_capture_is_wrong() -> None:
    case = FootageCase("cut", "error", Path("cut"), unusable=True, error="cut")
    assert judged(_result(_path()), REFERENCE, case).is_right is False
    assert judged(_result(_path()[:0]), REFERENCE, case).is_right is None


def _row(name: str, ours: dict[str, Any], plain: dict[str, Any]) -> Row:
    case = FootageCase(name, "set", Path(name))
    return Row(case, ours, judged(ours, REFERENCE, case), plain, judged(plain, REFERENCE, case), REFERENCE.focal)


def _summary(*rows: Row) -> dict[str, str]:
    head, _, *lines = summary_rows(rows).splitlines()
    names, cells = ([cell.strip() for cell in line.split("|")[1:-1]] for line in (head, lines[0]))
    return dict(zip(names, cells, strict=True))


def test_the_summary_counts_what_was_refused_and_what_was_wrong() -> None:
    bent = _path() * [1, 0.5, 1]
    rows = [
        _row("good", _result(_path()), _result(_path(), cpu_s=20.0)),
        _row("refused", _result(_path(), code="drift"), _result(_path(), cpu_s=10.0)),
        _row("wrong", _result(bent), _result(bent)),
        _row("fewer", _result(_path()[:12]), _result(_path()[:15])),
        _row("small", _result(_path()[:10], code="too_few_frames"), _result(_path()[:10])),
    ]
    summary = _summary(*rows)
    assert summary["cases"] == "5"
    assert summary["CPU ratio, median"] == "1.00"
    assert summary["fewer placed than plain places right"] == "3: `refused`, `fewer`, `small`"
    assert summary["right models refused"] == "1: `refused`"
    assert summary["refused, and plain is right"] == "1: `refused`"
    assert summary["wrong models accepted"] == "1: `wrong`"
    assert summary["plain: wrong models"] == "1: `wrong`"


def test_the_table_has_both_results_and_names_what_was_not_run() -> None:
    row = _row("good", _result(_path()), _result(_path()[:15], focal=0.7))
    alone = Row(CASE, row.ours, row.judgement)
    lines = table([row, alone]).splitlines()
    assert lines[2].startswith("| **Sets**")
    assert "| `good` | 20 | accepted | 20 | 20 | 0.0 (0.0) | 30 | 15 | 15 |" in lines[3]
    assert "not run" in lines[4]
    assert len({line.count("|") for line in lines}) == 1


def test_the_conditions_name_version_load_and_missing_cases() -> None:
    row = _row("good", _result(_path(), load=4.0, commit="abc"), _result(_path(), load=9.0))
    others = [row.case, CASE, FootageCase("walk, first half", "part", Path("walk"))]
    text = conditions([row], others)
    assert "abc (1 cases)" in text
    assert "4 to 9, median 6" in text
    assert "Sets: 1 of 2 not run: `walk`." in text
    assert "Parts of sets: none of 1 was run." in text


SOUND: dict[str, Any] = {
    "names": [f"{index:06d}.jpg" for index in range(20)], "points": 900, "error_px": 0.4,
    "focal": 0.8, "lens_bend": 0.01, "camera": "SIMPLE_RADIAL", "focal_deviation": 0.01, "triplets": 100,
    "pieces": [20],
}  # fmt: skip


@pytest.mark.parametrize(
    ("gate", "fired", "passed"),
    [
        ("too few placed", {"names": SOUND["names"][:10]}, {"names": SOUND["names"][:11]}),
        ("parts", {"pieces": [10, 6]}, {"pieces": [10, 5]}),
        ("focal length undetermined", {"focal_deviation": 1.1 * MAX_FOCAL_STD}, {"focal_deviation": MAX_FOCAL_STD}),
        ("focal lengths across and down", {"aspect": 1.06}, {"aspect": 1.04}),
        ("displacement of the corners", {"lens_bend": 0.3}, {"lens_bend": 0.3, "camera": "OPENCV_FISHEYE"}),
        ("change of the focal length", {"focal_change": MIN_ZOOM + 0.01}, {"focal_change": MIN_ZOOM}),
        (
            "contradicted triplets",
            {"contradicted": round(100 * MAX_CONTRADICTED_RATIO) + 1},
            {"contradicted": round(100 * MAX_CONTRADICTED_RATIO)},
        ),
        ("broken frames", {"broken": ["a"] * MIN_BROKEN_FRAMES}, {"broken": ["a"] * (MIN_BROKEN_FRAMES - 1)}),
    ],
)
def test_each_gate_is_judged_on_its_own(gate: str, fired: dict[str, Any], passed: dict[str, Any]) -> None:
    assert gates_of(SOUND | fired, 20) == {gate}
    assert gates_of(SOUND | fired | {"pieces": [10, 6]}, 20) == {gate, "parts"}
    assert gates_of(SOUND | passed, 20) == set()
    assert set(GATES) >= {gate}


def test_the_rates_of_the_gates_are_counted_by_kind_of_model() -> None:
    far = SOUND | {"pieces": [10, 6]}
    bent = _path() * [1, 0.5, 1]
    case = FootageCase("drive", "error", Path("drive"), error="straight drive")
    fired, passed = gates_of(far, 20), gates_of(SOUND, 20)
    missed = _result(_path(), gates=passed, focal=1.6)
    rows = [
        _row("refused", _result(_path(), gates=fired, code="pure_rotation"), _result(_path(), gates=passed)),
        _row("wrong", _result(bent, gates=passed), _result(bent, gates=fired)),
        _row("figures not kept", _result(bent, gates=None), _result(bent, gates=None)),
        Row(case, missed, judged(missed, REFERENCE, case)),
    ]
    lines = gate_table(rows).splitlines()
    assert "| models | 1 | 1 | 0 | 1 | 1 | 1 |" in lines
    assert "| parts | 1 | 0 | 0 | 0 | 1 | 0 |" in lines
    assert not [line for line in lines if line.startswith("| broken frames")]
    assert "| straight drive | 1 accepted, wrong |" in lines


def test_results_that_exist_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither program is started for a case with both results."""
    for name in ("desk.json", "desk.plain.json"):
        (tmp_path / name).write_text("{}", encoding="utf-8")
    case = FootageCase("desk", "set", tmp_path / "desk")
    monkeypatch.setattr("benchmarks.estimator.real_footage.set_cases", lambda data: [case])
    monkeypatch.setattr("benchmarks.estimator.real_footage.run_child", lambda *words: pytest.fail("it was run again"))
    words = ["real_footage", str(tmp_path), "--out", str(tmp_path), "--against", "pycolmap", "--only", "desk"]
    monkeypatch.setattr("sys.argv", words)
    main()
    assert (tmp_path / "desk.json").read_text(encoding="utf-8") == "{}"


def test_a_set_without_a_model_has_no_reference(tmp_path: Path) -> None:
    assert read_reference(FootageCase("desk", "set", tmp_path), tmp_path) is None


def test_parts_that_are_as_good_as_plain_are_only_counted() -> None:
    full, some, bent = _result(_path()), _result(_path()[:15]), _result(_path() * [1, 0.5, 1])
    rows = [_row("a", full, some), _row("b", some, full), _row("c", bent, bent), _row("d", full | {"code": "x"}, some)]
    parts = [replace(row, case=replace(row.case, group="part")) for row in rows]
    lines = table(parts).splitlines()
    assert "Parts of sets, and 1 that are right, with no fewer right images than plain" in lines[2]
    assert [line.split("|")[1].strip() for line in lines[3:]] == ["`b`", "`c`", "`d`"]


def test_stored_rows_give_the_same_tables(tmp_path: Path) -> None:
    fired = gates_of(SOUND | {"focal_deviation": None}, 20)
    case = FootageCase("drive", "error", Path("drive"), unusable=True, error="straight drive")
    missed = _result(_path(), gates=set(), focal=1.6)
    rows = [
        _row("good, all", _result(_path(), gates=None, load=3.0, commit="abc"), _result(_path()[:15], gates=fired)),
        _row("refused", _result(_path()[:3], gates=fired, code="too_few_frames"), _result(_path()[:0], focal=None)),
        Row(case, missed, judged(missed, REFERENCE, case)),
    ]
    write_rows(rows, tmp_path / "rows.csv")
    stored = read_rows(tmp_path / "rows.csv")
    for text in (table, summary_rows, gate_table, lambda some: conditions(some, [CASE])):
        assert text(stored) == text(rows)
    assert read_rows(tmp_path / "missing.csv") == []


def test_a_fresh_row_keeps_the_stored_result_of_plain_pycolmap() -> None:
    stored = [_row("a", _result(_path()), _result(_path()[:15])), _row("b", _result(_path()), _result(_path()))]
    alone = replace(stored[1], ours=_result(_path(), code="drift"), plain=None, plain_judgement=None)
    after = updated_rows(stored, [alone, _row("c", _result(_path()), _result(_path()))])
    assert [row.case.name for row in after] == ["a", "b", "c"]
    assert (after[1].ours["code"], after[1].plain) == ("drift", stored[1].plain)


def test_the_page_has_the_tables_of_the_stored_rows() -> None:
    rows, page = read_rows(ROWS), AGAINST_PAGE.read_text(encoding="utf-8")
    assert len(rows) == len({row.case.name for row in rows}) > 100
    for text in (table(rows), summary_rows(rows), conditions(rows, []), gate_table(rows)):
        assert text in page
