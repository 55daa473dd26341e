"""Dense points by COLMAP's PatchMatch on a GPU (Schoenberger 2016), in the layout that the plane sweep writes."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from estimator.capture.mapping.worker_process import start_worker, wait_for_worker
from estimator.reconstructions.colmap import read_colmap
from estimator.reconstructions.ply import read_visibility, visibility_bytes
from metric_base.progress import ProgressCallback

__all__ = ["make_patch_match_cloud"]

WORKER = "estimator.capture.dense.patch_match_worker"
THREADS = 2


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
    process = start_worker("dense", request, file.parent, WORKER)
    result = wait_for_worker(process, "dense", file.parent / "dense.log", progress)
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
