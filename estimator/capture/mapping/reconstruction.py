"""Structure from motion over the chosen frames: features, matches, and two mappers that must agree."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimator.capture.mapping.evidence import Evidence, ModelShape, model_disagreement, model_shape
from estimator.capture.mapping.failures import Failure
from estimator.capture.mapping.gates import early_failure, model_failure
from estimator.capture.mapping.worker_process import start_worker, wait_for_worker
from metric_base.progress import progress_bar

__all__ = ["Lens", "make_features", "make_matches", "make_model"]

#: SIFT features a frame: four times as many take four times as long and halve an error that is below a millimetre.
MAX_FEATURES = 2500
#: Longer side at which features are looked for.
MAX_SIDE = 1000
#: Focal length over the longer side before anything is known: a telephone's main camera while filming.
FOCAL_FACTOR = 0.85
THREADS = 2

#: Threads of each of the two mappers, which run at once. With one the same matches give the same model; with more the
#: sums of the adjustment are added in another order each time, which moves a focal length by up to 1 %.
MAPPING_THREADS = 1
#: Frames that the global mapper checks the incremental one on; it takes twice as long for as many.
CHECKED = 50


@dataclass(frozen=True, slots=True)
class Lens:
    """What is known of the camera: COLMAP's model, and the focal length in pixels of the frames or None.

    fixed : the focal length is given by the user and not refined; one_camera : all frames are of one size.
    """

    model: str
    focal_px: float | None
    fixed: bool
    one_camera: bool
    width: int
    height: int

    @property
    def params(self) -> str:
        """COLMAP's `camera_params`, empty where the focal length is not known."""
        if self.focal_px is None:
            return ""
        from estimator.reconstructions.cameras import CAMERA_MODELS

        known = {"cx": self.width / 2, "cy": self.height / 2} | dict.fromkeys(("f", "fx", "fy"), self.focal_px)
        return ",".join(repr(float(known.get(name, 0.0))) for name in CAMERA_MODELS[self.model][1])


def make_features(part: Path, pictures: Path, names: list[str], lens: Lens) -> None:
    """`features.db` and `features.json` in the part folder."""
    request = {
        "database": str(part / "features.db"),
        "pictures": str(pictures),
        "names": names,
        "camera_model": lens.model,
        "camera_params": lens.params,
        "focal_factor": FOCAL_FACTOR,
        "one_camera": lens.one_camera,
        "max_features": MAX_FEATURES,
        "max_side": MAX_SIDE,
        "threads": THREADS,
    }
    with progress_bar("features", len(names)) as told:
        process = start_worker("features", request, part)
        result = wait_for_worker(process, "features", part / "features.log", told)
    (part / "features.json").write_text(json.dumps(result), encoding="utf-8")


def make_matches(part: Path, features: Path, names: list[str], in_order: bool) -> None:
    """`matches.db` and `matches.json` in the part folder; `features` is the folder of the features."""
    shutil.copyfile(features / "features.db", part / "matches.db")
    request = {"database": str(part / "matches.db"), "names": names, "in_order": in_order, "threads": THREADS}
    with progress_bar("matches") as told:
        process = start_worker("matches", request, part)
        result = wait_for_worker(process, "matches", part / "matches.log", told)
    (part / "matches.json").write_text(json.dumps(result), encoding="utf-8")


def make_model(part: Path, matches: Path, pictures: Path, evidence: Evidence, lens: Lens) -> None:
    """`sparse/0` and `reconstruction.json` in the part folder; of a failure only the latter.

    The incremental mapper makes the model; the global one, which turns pure rotation into a convincing false model,
    only checks its shape.
    """
    early = early_failure(evidence)
    if early is not None:
        _write_report(part, early, evidence, None, None)
        return
    requests = {
        step: _request(part, matches, pictures, evidence.names, step, lens, seed=0)
        for step in ("incremental", "global")
    }
    requests["global"]["names"] = evidence.names[:: max(1, len(evidence.names) // CHECKED)]
    with progress_bar("mapping", len(evidence.names)) as told:
        processes = {step: start_worker(step, request, part) for step, request in requests.items()}
        try:
            wait_for_worker(processes["incremental"], "incremental", part / "incremental.log", told)
            shape = model_shape(part / "incremental" / "0")
            wait_for_worker(processes["global"], "global", part / "global.log")
        finally:
            for process in processes.values():
                if process.poll() is None:
                    process.kill()
    failure = model_failure(evidence, shape, None, lens.fixed)
    disagreement = None
    if failure is None and shape is not None:
        disagreement = model_disagreement(shape, model_shape(part / "global" / "0"))
        failure = model_failure(evidence, shape, disagreement, lens.fixed)
    if failure is None:
        (part / "sparse").mkdir()
        (part / "incremental" / "0").rename(part / "sparse" / "0")
    _write_report(part, failure, evidence, shape, disagreement)


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
        "forward": False,
        "colours": step == "incremental",
    }


def _write_report(
    part: Path, failure: Failure | None, evidence: Evidence, shape: ModelShape | None, disagreement: float | None
) -> None:
    report = {
        "failure": None if failure is None else failure.json(),
        "pairs": evidence.summary(),
        "model": None if shape is None else shape.summary(),
        "disagreement": disagreement,
    }
    (part / "reconstruction.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
