"""Map the frames from their verified matches, and accept or refuse the model with a report."""

from __future__ import annotations

import json
import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from capture.mapping.camera_models import CameraModelChoice
from capture.mapping.camera_prior import FISHEYE, Lens
from capture.mapping.match_graph import MatchGraph
from capture.mapping.model_metrics import ModelMetrics
from capture.mapping.refusals import (
    DISPUTABLE,
    MAX_DISAGREEMENT,
    MAX_MODEL_FOCAL_CHANGE,
    TYPICAL_FOCAL,
    Failure,
    early_failure,
    model_failure,
    refusal,
)
from capture.mapping.worker import OutOfTime, TimeLimit, WorkerError, run_worker
from metric_base.progress import ProgressCallback, silent

#: Camera models and focal lengths, relative to the longer side, of usual wide lenses: the second camera of a phone,
#: which corrects its distortion, and two action cameras. The mapping converges from a fisheye focal length within 20 %
#: of the true one.
WIDE_STARTS = (("SIMPLE_RADIAL", 0.4), (FISHEYE, 0.48), (FISHEYE, 0.34))
#: Extra time in seconds after the limit, to finish the best model.
EXTRA_TIME_S = 60.0


class ModelReport(msgspec.Struct, kw_only=True):
    """Outcome of a mapping; the content of `reconstruction.json`."""

    failure: Failure | None = None  #: Why the model cannot be used.
    model: ModelMetrics | None = None  #: Figures of the model; None without a model.
    left_out: list[str] = []  #: Frames without a place in the model.
    pairs: dict[str, Any] = {}  #: Figures of the matches.
    disagreement: float | None = None  #: Distance of both mappers' paths relative to their extent, if compared.
    overruled: Failure | None = None  #: Failure that is a warning, because both mappers agree.
    focal_held: bool = False  #: Whether the focal length was not refined.
    lenses: CameraModelChoice | None = None  #: Comparison of the camera models, if the residuals have a pattern.

    @property
    def n_placed(self) -> int:
        """Number of frames in the model."""
        return 0 if self.model is None else self.model.registered


def make_model(
    output: Path,
    matches: Path,
    images: Path,
    graph: MatchGraph,
    lens: Lens,
    *,
    limit: TimeLimit,
    progress: ProgressCallback = silent,
) -> None:
    """Write a model as the folder `output`, and its report as `output` with the suffix `.json`.

    After a failure only the report is written.

    Parameters
    ----------
    output : Path
        Folder of the model, which does not exist yet.
    matches, images : Path
        Database of the verified matches, and folder of the frames.
    graph : MatchGraph
        Frames and matched pairs.
    lens : Lens
        Assumed camera model, and the focal length if it is known.

    Raises
    ------
    OutOfTime
        The limit ended the mapping before there was a model.
    """
    folder = output.with_name(f"{output.name}.made")
    folder.mkdir()
    report = ModelReport(failure=early_failure(graph), pairs=graph.summary(), focal_held=lens.fixed)
    if report.failure is None:
        database = folder / "matches.db"
        shutil.copyfile(matches, database)  # the mappers write to their database
        request = {
            "database": str(database),
            "images": str(images),
            "cameras": candidate_cameras(lens),
            "fixed": lens.fixed,
        }
        request |= {"free": lens.free, "linked": len(graph.groups()[0])}
        result = _mapped(folder, request, limit, progress)
        report.model = msgspec.convert(result["model"], ModelMetrics | None)
        report.lenses = msgspec.convert(result.get("lenses"), CameraModelChoice | None)
        report.failure = model_failure(graph, report.model, lens.fixed)
        if report.failure is None and report.lenses is not None and not lens.free:
            report.failure = camera_model_failure(report.lenses)
        if report.failure is not None and report.failure.code in DISPUTABLE and report.n_placed == len(graph.names):
            other = folder / "global"
            other.mkdir()
            request = {"database": result["matches"], "images": str(images), "folder": result["folder"]}
            with suppress(OutOfTime, WorkerError):
                compared = run_worker("compare_global", request | {"output": str(other)}, folder, limit=limit)
                report.disagreement = compared["disagreement"]
            if report.disagreement is not None and report.disagreement < MAX_DISAGREEMENT:
                report.failure, report.overruled = None, report.failure
        if report.failure is None:
            Path(result["folder"]).rename(output)
    placed = set() if report.model is None else set(report.model.names)
    report.left_out = [name for name in graph.names if name not in placed]
    document = msgspec.to_builtins(report)
    output.with_name(f"{output.name}.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _mapped(folder: Path, request: dict[str, Any], limit: TimeLimit, progress: ProgressCallback) -> dict[str, Any]:
    """Return the result of the mapping, or of the best model before an early stop."""
    output = folder / "models"
    output.mkdir()
    request = request | {"output": str(output)}
    try:
        return dict(run_worker("mapping", request, folder, progress=progress, limit=limit))
    except (OutOfTime, WorkerError):
        if not any(part.is_dir() for part in output.iterdir()):
            raise
        rest = TimeLimit(limit.now_s() + EXTRA_TIME_S, limit.of_processor)
        return dict(run_worker("finish", request, folder, limit=rest))


def camera_model_failure(lenses: CameraModelChoice) -> Failure | None:
    """Return the failure of a camera model that the user gave, if another fits better with another focal length."""
    change = lenses.focal_difference
    if abs(change) <= MAX_MODEL_FOCAL_CHANGE:
        return None
    better, given = lenses.scores[lenses.chosen], lenses.scores[lenses.before]
    seen = (
        f"{lenses.chosen} has residuals of {better.error_px:.2f} px instead of {given.error_px:.2f} px with "
        f"{lenses.before}, and its focal length differs by {100 * abs(change):.0f} %"
    )
    return refusal("wrong_camera_model", seen)


def candidate_cameras(lens: Lens) -> list[dict[str, Any]]:
    """Return the cameras to map with in turn, until most frames are placed.

    A stated wide lens comes first, then the assumed camera. The first two frames of a straight drive hardly constrain
    the focal length: in one case it became 4 times the width (true: 0.78), and only 6 of 32 frames fitted. The next
    camera is therefore held until all frames are placed: the assumed one if EXIF states the focal length, otherwise one
    with `TYPICAL_FOCAL`. Usual wide lenses follow, unless EXIF states the focal length. The worker decides whether EXIF
    does, because COLMAP reads more tags than `Lens`.
    """
    assumed: dict[str, Any] = {"model": lens.model, "params": None, "held": False, "if_stated": None}
    if lens.fixed or not lens.free:
        return [assumed]

    def start(model: str, focal_px: float, held: bool, if_stated: bool | None = False) -> dict[str, Any]:
        params = replace(lens, model=model, focal_px=focal_px).params
        return {"model": model, "params": params, "held": held, "if_stated": if_stated}

    side = max(lens.width, lens.height)
    cameras = [] if lens.wide_px is None else [start(FISHEYE, lens.wide_px, True, None)]
    cameras += [assumed, assumed | {"held": True, "if_stated": True}, start(lens.model, TYPICAL_FOCAL * side, True)]
    return cameras + [start(model, ratio * side, "FISHEYE" in model) for model, ratio in WIDE_STARTS]
