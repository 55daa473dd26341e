"""Structure from motion over the chosen frames: features, matches, and two mappers that must agree."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from estimator.capture.mapping.evidence import Evidence, ModelShape, model_disagreement, model_shape
from estimator.capture.mapping.failures import TYPICAL_FOCAL, Failure
from estimator.capture.mapping.gates import early_failure, focal_is_determined, focal_undetermined, model_failure
from estimator.capture.mapping.worker_process import start_worker, wait_for_worker
from metric_base.progress import ProgressCallback, silent

__all__ = ["Lens", "make_features", "make_matches", "make_model"]

#: SIFT features a frame: four times as many take four times as long and halve an error that is below a millimetre.
MAX_FEATURES = 2500
#: Longer side at which features are looked for.
MAX_SIDE = 1000
THREADS = 2

#: Threads of each of the two mappers, which run at once. With one the same matches give the same model; with more the
#: sums of the adjustment are added in another order each time, which moves a focal length by up to 1 %.
MAPPING_THREADS = 1
#: Frames that the global mapper checks the incremental one on; it takes twice as long for as many.
CHECKED = 50


#: Failures that go away if the focal length is held: with an open one the mapper may not get beyond two frames.
OF_THE_FOCAL = frozenset({"focal_length_undetermined", "too_few_frames"})


@dataclass(frozen=True, slots=True, eq=False)
class _Mapped:
    """What the two mappers made: a failure that it shows, its shape and folder, whether the focal length was held."""

    failure: Failure | None = None
    shape: ModelShape | None = None
    disagreement: float | None = None
    model: Path | None = None
    focal_held: bool = False


@dataclass(frozen=True, slots=True)
class Lens:
    """What is known of the camera: COLMAP's model, and the focal length in pixels of the frames or None.

    fixed : the focal length is given by the user and not refined; width, height : of the frames; rough : the focal
    length is that of the camera's photographs, and its videos may be cropped: a start that is never held.
    """

    model: str
    focal_px: float | None
    fixed: bool
    width: int
    height: int
    rough: bool = False

    @property
    def params(self) -> str:
        """COLMAP's `camera_params`, empty where the focal length is not known."""
        if self.focal_px is None:
            return ""
        from estimator.reconstructions.cameras import CAMERA_MODELS

        known = {"cx": self.width / 2, "cy": self.height / 2} | dict.fromkeys(("f", "fx", "fy"), self.focal_px)
        return ",".join(repr(float(known.get(name, 0.0))) for name in CAMERA_MODELS[self.model][1])


def make_features(
    part: Path, pictures: Path, cameras: list[tuple[Lens, list[str]]], progress: ProgressCallback = silent
) -> None:
    """`features.db` and `features.json` in the part folder; cameras : the lens of each, and the names of its frames."""
    n = sum(len(names) for _, names in cameras)
    request = {
        "database": str(part / "features.db"),
        "pictures": str(pictures),
        "camera_model": cameras[0][0].model,
        "cameras": [{"params": lens.params, "names": names} for lens, names in cameras],
        "focal_factor": TYPICAL_FOCAL,
        "max_features": MAX_FEATURES,
        "max_side": MAX_SIDE,
        "threads": THREADS,
    }
    process = start_worker("features", request, part)
    result = wait_for_worker(process, "features", part / "features.log", progress, n)
    (part / "features.json").write_text(json.dumps(result), encoding="utf-8")


def make_matches(
    part: Path, features: Path, names: list[str], in_order: bool, progress: ProgressCallback = silent
) -> None:
    """`matches.db` and `matches.json` in the part folder; `features` is the folder of the features."""
    shutil.copyfile(features / "features.db", part / "matches.db")
    request = {"database": str(part / "matches.db"), "names": names, "in_order": in_order, "threads": THREADS}
    process = start_worker("matches", request, part)
    result = wait_for_worker(process, "matches", part / "matches.log", progress)
    (part / "matches.json").write_text(json.dumps(result), encoding="utf-8")


def make_model(
    part: Path, matches: Path, pictures: Path, evidence: Evidence, lens: Lens, progress: ProgressCallback = silent
) -> None:
    """`sparse/0` and `reconstruction.json` in the part folder; of a failure only the latter.

    The incremental mapper makes the model; the global one, which turns pure rotation into a convincing false model,
    only checks its shape. Where most frames cannot be placed, the mappers run again and adjust the focal length last.
    Where the frames leave the focal length open, one that is stated is held and the mappers run again.
    """
    early = early_failure(evidence)
    mapped = _Mapped(failure=early) if early is not None else _map(part, matches, pictures, evidence, lens, progress)
    if early is None and mapped.failure is not None and mapped.failure.code == "too_few_frames" and not lens.fixed:
        mapped = _map_with_focal_last(part, matches, pictures, evidence, lens, mapped, progress)
    if early is None and mapped.failure is not None and not lens.fixed and mapped.failure.code in OF_THE_FOCAL:
        mapped = _map_with_held_focal(part, matches, pictures, evidence, lens, mapped, progress)
    if mapped.failure is None and mapped.model is not None:
        (part / "sparse").mkdir()
        mapped.model.rename(part / "sparse" / "0")
    _write_report(part, mapped, evidence)


def _map_with_focal_last(
    part: Path,
    matches: Path,
    pictures: Path,
    evidence: Evidence,
    lens: Lens,
    mapped: _Mapped,
    progress: ProgressCallback,
) -> _Mapped:
    """The mapping again with the focal length adjusted at the end, if that places the frames; else as it was.

    On a straight drive the first two frames say next to nothing about the focal length: one of 4 times the width came
    out where 0.78 was true, and 6 of 32 frames fitted it.
    """
    again = part / "focal_last"
    again.mkdir()
    last = _map(again, matches, pictures, evidence, lens, progress, focal_last=True)
    return last if last.failure is None else mapped


def _map_with_held_focal(
    part: Path,
    matches: Path,
    pictures: Path,
    evidence: Evidence,
    lens: Lens,
    mapped: _Mapped,
    progress: ProgressCallback,
) -> _Mapped:
    """The mapping again with the stated or, to find out what was wrong, a typical focal length."""
    assert mapped.failure is not None
    stated = lens.focal_px is not None and not lens.rough
    if not stated and mapped.failure.code == "focal_length_undetermined":
        return mapped
    again = part / "held"
    again.mkdir()
    held = _map(again, matches, pictures, evidence, replace(lens, fixed=True), progress)
    if held.failure is not None or held.shape is None or focal_is_determined(held.shape):
        return mapped
    return held if stated else replace(mapped, failure=focal_undetermined())


def _map(
    part: Path,
    matches: Path,
    pictures: Path,
    evidence: Evidence,
    lens: Lens,
    progress: ProgressCallback,
    focal_last: bool = False,
) -> _Mapped:
    """Both mappers at once, and whether what they made can be used; `focal_last` : see `_map_with_focal_last`."""
    requests = {
        step: _request(part, matches, pictures, evidence.names, step, lens, seed=0) | {"focal_last": focal_last}
        for step in ("incremental", "global")
    }
    requests["global"]["names"] = evidence.names[:: max(1, len(evidence.names) // CHECKED)]
    processes = {step: start_worker(step, request, part) for step, request in requests.items()}
    try:
        result = wait_for_worker(
            processes["incremental"], "incremental", part / "incremental.log", progress, len(evidence.names)
        )
        model = part / "incremental" / "0"
        shape = model_shape(model, result["focal_deviation"])
        wait_for_worker(processes["global"], "global", part / "global.log")
    finally:
        for process in processes.values():
            if process.poll() is None:
                process.kill()
    stated = None if lens.focal_px is None else lens.focal_px / max(lens.width, lens.height)
    failure = model_failure(evidence, shape, None, lens.fixed, stated)
    disagreement = None
    if failure is None and shape is not None:
        disagreement = model_disagreement(shape, model_shape(part / "global" / "0"))
        failure = model_failure(evidence, shape, disagreement, lens.fixed, stated)
    return _Mapped(failure, shape, disagreement, model, lens.fixed)


def _request(
    part: Path, matches: Path, pictures: Path, names: list[str], step: str, lens: Lens, seed: int
) -> dict[str, Any]:
    scratch, output, database = part / f"{step}.scratch", part / step, part / f"{step}.db"
    scratch.mkdir()
    output.mkdir()
    shutil.copyfile(matches / "matches.db", database)  # each mapper writes to its own
    return {
        "database": str(database),
        "pictures": str(pictures),
        "scratch": str(scratch),
        "output": str(output),
        "names": names,
        "threads": MAPPING_THREADS,
        "seed": seed,
        "refine_focal": not lens.fixed,
        "colours": step == "incremental",
    }


def _write_report(part: Path, mapped: _Mapped, evidence: Evidence) -> None:
    report = {
        "failure": None if mapped.failure is None else mapped.failure.json(),
        "pairs": evidence.summary(),
        "model": None if mapped.shape is None else mapped.shape.summary(),
        "disagreement": mapped.disagreement,
        "focal_held": mapped.focal_held,
    }
    (part / "reconstruction.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
