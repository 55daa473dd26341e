"""Dense points of a model: by PatchMatch where a CUDA device answers, else by the plane sweep."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

import numpy as np

from capture.dense.fusion import make_dense_cloud
from estimator.capture.dense.cuda import PYCOLMAP, patch_match_engine
from estimator.capture.mapping.worker import WorkerError, run_worker
from estimator.reconstructions.colmap import read_colmap
from estimator.reconstructions.ply import read_visibility, visibility_bytes
from metric_base.progress import NoticeCallback, ProgressCallback, no_notice, silent

__all__ = ["make_dense_points"]


WORKER = "capture.dense.patch_match_worker"
THREADS = 2


def make_dense_points(
    model: Path, pictures: Path, file: Path, progress: ProgressCallback = silent, notice: NoticeCallback = no_notice
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


def make_patch_match_cloud(model: Path, pictures: Path, file: Path, engine: str, progress: ProgressCallback) -> int:
    """Write `file` (PLY with colours and normals) and `file.vis` of a COLMAP model; how many points there are.

    engine : of `patch_match_engine`. With no point nothing is written. progress : counts the three steps.

    Raises
    ------
    WorkerError
        It ended without a result, as on a device without enough memory.
    """
    workspace = file.with_name("stereo.scratch")
    workspace.mkdir()
    request = {
        "workspace": str(workspace),
        "model": str(model),
        "pictures": str(pictures),
        "engine": engine,
        "threads": THREADS,
    }
    result = run_worker("dense", request, file.parent, progress=progress, module=WORKER)
    points = int(result["points"])
    if points:
        (workspace / "fused.ply").rename(file)
        rows = {view.name: row for row, view in enumerate(read_colmap(model).views)}
        order = np.array([rows[name] for name in result["names"]])
        offsets, views = read_visibility(workspace / "fused.ply.vis", points, len(order))
        # the workspace has the views in another order than the model's file
        file.with_name(f"{file.name}.vis").write_bytes(visibility_bytes(offsets, order[views]))
    shutil.rmtree(workspace)
    return points
