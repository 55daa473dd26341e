"""Whether a CUDA device answers, and which build of COLMAP can use it."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

__all__ = ["PYCOLMAP", "cuda_devices", "patch_match_engine"]

#: The engine that is the Python package itself (its build of the name `pycolmap-cuda12`).
PYCOLMAP = "pycolmap"
DRIVER = "libcuda.so.1"
#: How long the program may take to print its help.
SECONDS = 30


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
