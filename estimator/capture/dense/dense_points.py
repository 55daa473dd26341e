"""Dense points of a model: by PatchMatch where a CUDA device answers, else by the plane sweep."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from estimator.capture.dense.cuda import PYCOLMAP, patch_match_engine
from estimator.capture.dense.dense_cloud import make_dense_cloud
from estimator.capture.dense.patch_match import make_patch_match_cloud
from estimator.capture.mapping.worker_process import WorkerError
from estimator.reconstructions.colmap import read_colmap
from metric_base.progress import NoticeCallback, ProgressCallback, no_notice, silent

__all__ = ["make_dense_points"]


def make_dense_points(
    model: Path,
    pictures: Path,
    file: Path,
    progress: ProgressCallback = silent,
    notice: NoticeCallback = no_notice,
) -> int:
    """Write `file` and `file.vis` of a COLMAP model and the folder of its pictures; how many points there are.

    notice : is called with a sentence that says which way was taken.
    """
    engine = patch_match_engine()
    if engine is not None:
        name = "pycolmap" if engine == PYCOLMAP else engine
        notice(f"dense points by PatchMatch on CUDA ({name})")
        try:
            return make_patch_match_cloud(model, pictures, file, engine, progress)
        except WorkerError as error:
            notice(f"warning: PatchMatch failed, and the plane sweep on the CPU is used: {error}")
    else:
        notice("dense points by a plane sweep on the CPU: no CUDA device, or no COLMAP that was built with CUDA")
    return make_dense_cloud(read_colmap(model), pictures, file, partial(progress, "dense points, plane sweep"))
