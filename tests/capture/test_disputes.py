"""A refused model that the global mapper confirms, and models that the time limit ends."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from capture.mapping import mapper
from capture.mapping.camera_models import CameraModelChoice, ModelScore
from capture.mapping.camera_prior import Lens
from capture.mapping.mapper import ModelReport, make_model
from capture.mapping.worker import OutOfTime, TimeLimit, WorkerError
from tests.support.captures import right_model, walk_graph

NAMES = walk_graph().names
DRIFT = {"broken": ("a.jpg", "b.jpg")}
BENT = {"lens_bend": 0.3}
UNDETERMINED = {"focal_deviation": 0.3}


class Worker:
    """Stands for the process of COLMAP: results or errors by step, and the steps that were run with their limits."""

    def __init__(self, results: dict[str, Any], n_models: int = 1) -> None:
        self.results, self.n_models = results, n_models
        self.steps: list[str] = []
        self.limits: list[TimeLimit] = []

    def __call__(self, step: str, request: dict[str, Any], _: Path, **options: Any) -> Any:
        self.steps.append(step)
        self.limits.append(options["limit"])
        if step == "mapping":
            for k in range(self.n_models):
                (Path(request["output"]) / str(k)).mkdir()
        result = self.results[step]
        if isinstance(result, Exception):
            raise result
        return result


def report_of(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    worker: Worker,
    lens: Lens | None = None,
    **changes: Any,
) -> ModelReport:
    """The report of a model with changes of the right figures."""
    (folder / "found").mkdir()
    found = {"model": None if changes.get("model", 1) is None else msgspec.to_builtins(right_model(**changes))}
    found |= {"folder": str(folder / "found"), "matches": str(folder / "m.db")}
    worker.results = {"mapping": found, "finish": found} | worker.results
    if isinstance(worker.results["mapping"], dict) and "lenses" in worker.results:
        worker.results["mapping"] = found | {"lenses": worker.results["lenses"]}
    monkeypatch.setattr(mapper, "run_worker", worker)
    (folder / "m.db").touch()
    lens = lens or Lens("SIMPLE_RADIAL", 500.0, False, 640, 480, free=True)
    make_model(folder / "model", folder / "m.db", folder, walk_graph(), lens, limit=TimeLimit(1e9))
    return msgspec.json.decode((folder / "model.json").read_bytes(), type=ModelReport)


@pytest.mark.parametrize(
    ("changes", "disagreement", "code", "overruled"),
    [
        (DRIFT, 0.009, None, "drift"),
        (DRIFT, 0.011, "drift", None),
        (DRIFT, OutOfTime("compare_global"), "drift", None),
        (DRIFT, WorkerError("no model"), "drift", None),
        (BENT, 0.009, None, "implausible_focal_length"),
        (BENT, 0.011, "implausible_focal_length", None),
    ],
)
def test_a_model_is_used_if_both_mappers_agree_within_a_hundredth(
    changes: dict[str, Any],
    disagreement: float | Exception,
    code: str | None,
    overruled: str | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """MAX_DISAGREEMENT, relative to the extent of the path."""
    compared = disagreement if isinstance(disagreement, Exception) else {"disagreement": disagreement}
    worker = Worker({"compare_global": compared})
    report = report_of(tmp_path, monkeypatch, worker, **changes)
    assert worker.steps == ["mapping", "compare_global"]
    assert (report.failure and report.failure.code) == code
    assert (report.overruled and report.overruled.code) == overruled
    assert report.disagreement == (disagreement if isinstance(disagreement, float) else None)
    assert (tmp_path / "model").is_dir() == (code is None)


@pytest.mark.parametrize(
    ("changes", "code"),
    [({}, None), (UNDETERMINED, "focal_length_undetermined"), (DRIFT | {"names": tuple(NAMES[:19])}, "drift")],
)
def test_other_models_are_not_compared(
    changes: dict[str, Any], code: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Right models, failures that both mappers share, and models without a frame."""
    worker = Worker({})
    report = report_of(tmp_path, monkeypatch, worker, **changes)
    assert worker.steps == ["mapping"]
    assert (report.failure and report.failure.code) == code
    assert report.left_out == ([NAMES[19]] if "names" in changes else [])
    assert report.overruled is None


@pytest.mark.parametrize("n_models", [0, 2])
def test_the_best_model_is_finished_within_a_minute_of_the_limit(
    n_models: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """EXTRA_TIME_S; without a model the error is that of the mapping."""
    worker = Worker({"mapping": OutOfTime("mapping")}, n_models)
    if not n_models:
        with pytest.raises(OutOfTime):
            report_of(tmp_path, monkeypatch, worker)
        return
    monkeypatch.setattr(TimeLimit, "now_s", lambda _: 1000.0)
    assert report_of(tmp_path, monkeypatch, worker).failure is None
    assert worker.steps == ["mapping", "finish"]
    assert worker.limits == [TimeLimit(1e9), TimeLimit(1060.0)]


@pytest.mark.parametrize(
    ("free", "focal", "code"),
    [(False, 530.0, "wrong_camera_model"), (False, 520.0, None), (True, 530.0, None)],
)
def test_the_camera_model_of_the_user_is_refused_and_one_that_was_chosen_is_not(
    free: bool, focal: float, code: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The focal length differs by 6 or 4 %."""
    scores = {"OPENCV": ModelScore(0.4, 0.3, 0.01, [focal]), "SIMPLE_RADIAL": ModelScore(0.8, 0.0, 0.0, [500.0])}
    choice = CameraModelChoice(scores, "SIMPLE_RADIAL", "OPENCV")
    worker = Worker({"lenses": msgspec.to_builtins(choice)})
    lens = Lens("SIMPLE_RADIAL", 500.0, False, 640, 480, free=free)
    report = report_of(tmp_path, monkeypatch, worker, lens)
    assert (report.failure and report.failure.code) == code
    assert report.lenses == choice


def test_frames_that_cannot_be_used_are_not_mapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    worker = Worker({})
    monkeypatch.setattr(mapper, "run_worker", worker)
    (tmp_path / "m.db").touch()
    lens = Lens("SIMPLE_RADIAL", 500.0, True, 640, 480)
    make_model(tmp_path / "model", tmp_path / "m.db", tmp_path, walk_graph(5), lens, limit=TimeLimit(1e9))
    report = msgspec.json.decode((tmp_path / "model.json").read_bytes(), type=ModelReport)
    assert worker.steps == []
    assert report.failure is not None
    assert report.failure.code == "too_few_frames"
    assert report.focal_held
    assert report.left_out == NAMES[:5]
    assert not (tmp_path / "model").exists()
