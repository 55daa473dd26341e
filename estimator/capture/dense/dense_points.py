"""Dense points of a model: by PatchMatch where a CUDA device answers, else by the plane sweep."""

from __future__ import annotations

import sys
from pathlib import Path

from estimator.capture.dense.cuda import PYCOLMAP, patch_match_engine
from estimator.capture.dense.dense_cloud import make_dense_cloud
from estimator.capture.dense.patch_match import make_patch_match_cloud
from estimator.capture.mapping.worker_process import WorkerError
from estimator.reconstructions.colmap import read_colmap
from metric_base.progress import progress_bar

__all__ = ["make_dense_points"]


def make_dense_points(model: Path, pictures: Path, file: Path) -> int:
    """Write `file` and `file.vis` of a COLMAP model and the folder of its pictures; how many points there are.

    A line on standard error says which way was taken.
    """
    engine = patch_match_engine()
    if engine is not None:
        name = "pycolmap" if engine == PYCOLMAP else engine
        _say(f"dense points by PatchMatch on CUDA ({name})")
        try:
            with progress_bar("dense points, PatchMatch") as told_done:
                return make_patch_match_cloud(model, pictures, file, engine, told_done)
        except WorkerError as error:
            _say(f"warning: PatchMatch failed, and the plane sweep on the CPU is used: {error}")
    else:
        _say("dense points by a plane sweep on the CPU: no CUDA device, or no COLMAP that was built with CUDA")
    with progress_bar("dense points, plane sweep") as told_done:
        return make_dense_cloud(read_colmap(model), pictures, file, told_done)


def _say(words: str) -> None:
    sys.stderr.write(f"estimate-scale: {words}\n")
