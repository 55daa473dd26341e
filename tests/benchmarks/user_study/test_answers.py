"""The user study: the page holds its images, the report finds the observer that answered."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.user_study.answers import ANSWERS, ANSWERS_SCHEMA, StudyAnswer, read_answers
from benchmarks.user_study.curve import Observer, curve_of, wilson
from benchmarks.user_study.make import main
from benchmarks.user_study.page import FLAT, STEPS, expected_intervals, plan_text, study_page
from benchmarks.user_study.report import report_text, write_curve
from metric_base.errors import InputError
from metric_cli.insert_object.insert import main as insert_object


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Resample the participants 25 times instead of 150, each with a fit."""
    monkeypatch.setattr("benchmarks.user_study.curve.N_RESAMPLES", 25)


def _answers(observer: Observer, participants: int, repeats: int, seed: int) -> list[StudyAnswer]:
    generator = np.random.default_rng(seed)
    shares = observer.shares(np.array(STEPS, dtype=float))
    return [
        StudyAnswer(str(person), float(step), ANSWERS[generator.choice(3, p=share)])
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


def test_two_people_have_a_curve_and_no_interval() -> None:
    curve = curve_of(_answers(Observer(bias=0.05, sigma=0.1, criterion=0.1), 2, 6, 3))
    assert not curve.flat
    assert (curve.peak_interval, curve.noticeable_interval) == (None, None)


def test_answers_by_chance_are_a_flat_curve() -> None:
    generator = np.random.default_rng(2)
    answers = [StudyAnswer(str(k % 2), float(step), str(generator.choice(ANSWERS))) for k in range(6) for step in STEPS]
    assert curve_of(answers).flat


def test_people_who_do_not_look_do_not_widen_the_step() -> None:
    sharp = Observer(bias=0.05, sigma=0.06, criterion=0.08)
    generator = np.random.default_rng(4)
    careless = [
        StudyAnswer(f"random {k}", float(step), str(generator.choice(ANSWERS)))
        for k in range(6) for _ in range(2) for step in STEPS
    ]  # fmt: skip
    careless += [StudyAnswer("always", float(step), "right") for _ in range(2) for step in STEPS]
    curve = curve_of([*_answers(sharp, 12, 2, 1), *careless])
    assert (curve.participants, curve.careless, curve.flat) == (19, 7, False)
    assert curve.observer.noticeable == pytest.approx(sharp.noticeable, rel=0.2)
    assert "7 of them answer without regard to the size" in report_text(curve)


def test_the_plan_is_that_of_a_flat_curve() -> None:
    few, many = (expected_intervals(people, 2) for people in (25, 100))
    assert few[0] == pytest.approx(2 * many[0])
    assert FLAT.shares(np.array([-5.0]))[0, 1] == pytest.approx(0.65, abs=0.01)
    assert "27 people" in plan_text(2)


def test_a_file_that_is_there_twice_counts_once(tmp_path: Path) -> None:
    rows = [{"step": step, "answer": "right"} for step in STEPS]
    record = {"schema": ANSWERS_SCHEMA, "participant": "p", "study": "s", "object": "chair", "answers": rows}
    for name in ("a.json", "a (1).json"):
        (tmp_path / name).write_text(json.dumps(record))
    warnings: list[str] = []
    assert len(read_answers(tmp_path, warnings)) == len(STEPS)
    assert warnings == ["a.json has the same answers as a (1).json and counts once"]
    (tmp_path / "b.json").write_text(json.dumps(record | {"answers": rows[:3]}))
    with pytest.raises(InputError, match="participant: expected one file each"):
        read_answers(tmp_path)
    (tmp_path / "b.json").write_text(json.dumps(record | {"participant": "q", "study": "t", "object": "table"}))
    with pytest.raises(InputError, match=r"expected the answers of one page; found 2 about 'chair'.*1 about 'table'"):
        read_answers(tmp_path)


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
    with pytest.raises(InputError, match=words):
        read_answers(file)


def test_the_report_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for person in range(3):
        rows = [
            {"step": answer.step, "answer": answer.answer} for answer in _answers(Observer(0, 0.1, 0.1), 1, 3, person)
        ]
        record = {"schema": ANSWERS_SCHEMA, "participant": f"p{person}", "answers": rows}
        (tmp_path / f"{person}.json").write_text(json.dumps(record))
    figure = tmp_path / "curve.png"
    assert main(["report", str(tmp_path), "--figure", str(figure)]) == 0
    assert "just-noticeable step" in capsys.readouterr().out
    assert figure.stat().st_size > 5000


def test_a_flat_curve_is_drawn_without_an_observer(tmp_path: Path) -> None:
    curve, lines = curve_of(_answers(Observer(0, 0.1, 0.1), 3, 3, 0)), []
    with mpl.rc_context({"svg.fonttype": "none"}):
        for flat in (False, True):
            file = tmp_path / f"curve-{flat}.svg"
            write_curve(replace(curve, flat=flat), file)
            lines.append(">observer<" in file.read_text())
    assert lines == [True, False]


def test_a_scene_folder_may_be_called_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["study", "--model", "a.glb", "--scale", "1", "--out", "images"]
    assert insert_object(words) == 2
    assert "python -m benchmarks.user_study" in capsys.readouterr().err
    (tmp_path / "study").mkdir()
    assert insert_object(words) == 2
    assert "insert-object: study" in capsys.readouterr().err  # read as a scene, which it is not
