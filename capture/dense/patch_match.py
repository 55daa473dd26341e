"""Compute dense points by COLMAP's PatchMatch on a CUDA device, or by the plane sweep on the CPU."""

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

#: Engine: the Python package with CUDA (its build of the name `pycolmap-cuda12`).
PYCOLMAP = "pycolmap"
DRIVER = "libcuda.so.1"
#: Maximum time in seconds in which the program `colmap` prints its help.
MAX_HELP_S = 30
WORKER = "capture.dense.patch_match_worker"


def cuda_devices() -> int:
    """Return the number of devices by the CUDA driver, 0 without a driver."""
    try:
        driver = ctypes.CDLL(DRIVER)
    except OSError:
        return 0
    count = ctypes.c_int(0)
    if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0:
        return 0
    return count.value


def patch_match_engine() -> str | None:
    """Return `PYCOLMAP` or the path of a program `colmap` if it is built with CUDA and there is a device, else None."""
    if cuda_devices() == 0:
        return None
    from estimator.reconstructions.pycolmap_library import pycolmap

    if pycolmap.has_cuda:
        return PYCOLMAP
    program = shutil.which("colmap")
    if program is None:
        return None
    try:
        done = subprocess.run([program, "help"], capture_output=True, text=True, timeout=MAX_HELP_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return program if "with CUDA" in done.stdout else None  # other builds print "without CUDA"


def make_dense_points(
    model: Path, images: Path, file: Path, progress: ProgressCallback = silent, notice: NoticeCallback = no_notice
) -> int:
    """Write the dense points of a COLMAP model, and return their number.

    Parameters
    ----------
    model, images : Path
        Folders of the model and of its images.
    file : Path
        PLY file; `<file>.vis` has the visibility.
    progress : callable
    notice : callable
        Called with a sentence about the method.
    """
    engine = patch_match_engine()
    if engine is not None:
        notice(f"dense points by PatchMatch on CUDA ({engine})")
        try:
            return make_patch_match_cloud(model, images, file, engine, progress)
        except WorkerError as error:
            notice(f"warning: PatchMatch failed, and the plane sweep on the CPU is used: {error}")
    else:
        notice("dense points by a plane sweep on the CPU: no CUDA device, or no COLMAP that was built with CUDA")
    return make_dense_cloud(read_colmap(model), images, file, partial(progress, "dense points, plane sweep"))


def make_patch_match_cloud(model: Path, images: Path, file: Path, engine: str, progress: ProgressCallback) -> int:
    """Write dense points with colours and normals, and return their number; without points nothing is written.

    The arguments are those of `make_dense_points`, with the result of `patch_match_engine`.

    Raises
    ------
    WorkerError
        The step ended without a result, as on a device without enough memory.
    """
    workspace = file.with_name("stereo.scratch")
    workspace.mkdir()
    request = {"workspace": str(workspace), "model": str(model), "images": str(images), "engine": engine}
    result = run_worker("dense", request, file.parent, progress=progress, module=WORKER)
    points = int(result["points"])
    if points:
        (workspace / "fused.ply").rename(file)
        rows = {view.name: row for row, view in enumerate(read_colmap(model).views)}
        order = np.array([rows[name] for name in result["names"]])  # the workspace has another order of the views
        offsets, views = read_visibility(workspace / "fused.ply.vis", points, len(order))
        file.with_name(f"{file.name}.vis").write_bytes(visibility_bytes(offsets, order[views]))
    shutil.rmtree(workspace)
    return points
