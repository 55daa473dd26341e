"""pycolmap does no harm to zlib, whatever of ours is imported first."""

from __future__ import annotations

import subprocess
import sys

import pytest

COMPRESS = (
    "import zlib; c = zlib.compressobj(); data = c.compress(b'x' * 300) + c.flush(); print(zlib.decompress(data)[:1])"
)


@pytest.mark.parametrize("module", ["estimator.reconstructions.pycolmap_library", "capture.mapping.colmap_worker"])
def test_zlib_works_after_pycolmap(module: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", f"import {module}; {COMPRESS}"], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.strip() == "b'x'"
