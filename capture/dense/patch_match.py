"""Dense points of a model: by PatchMatch where a CUDA device answers, else by the plane sweep.

Whether a CUDA device answers, and which build of COLMAP can use it.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from functools import partial
from pathlib import Path

import numpy as np

from capture.dense.fusion import make_dense_cloud
from capture.mapping.worker import WorkerError, run_worker
from estimator.reconstructions.colmap import read_colmap
from estimator.reconstructions.ply import read_visibility, visibility_bytes
from metric_base.progress import NoticeCallback, ProgressCallback, no_notice, silent

#: The engine that is the Python package itself (its build of the name `pycolmap-cuda12`).
PYCOLMAP = "pycolmap"
DRIVER = "libcuda.so.1"
#: How long the program may take to print its help.
SECONDS = 30
WORKER = "capture.dense.patch_match_worker"
THREADS = 2


def cuda_devices() -> int:
    """How many devices the CUDA driver states, 0 without a driver."""
    try:
        driver = ctypes.CDLL(DRIVER)
    except OSError:
        return 0
    count = ctypes.c_int(0)
    if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0:
        return 0
    return count.value


def patch_match_engine() -> str | None:
    """`PYCOLMAP`, or the path of a `colmap` program, if one was built with CUDA and a device answers; else None."""
    if cuda_devices() == 0:
        return None
    from estimator.reconstructions.pycolmap_library import pycolmap

    if pycolmap.has_cuda:
        return PYCOLMAP
    program = shutil.which("colmap")
    return program if program is not None and _has_cuda(program) else None


def _has_cuda(program: str) -> bool:
    """Whether the help of a `colmap` program says that it was built with CUDA; builds without say "without CUDA"."""
    try:
        done = subprocess.run([program, "help"], capture_output=True, text=True, timeout=SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return "with CUDA" in done.stdout


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
