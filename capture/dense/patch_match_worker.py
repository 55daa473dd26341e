"""COLMAP's dense reconstruction in a process of its own.

`python -m capture.dense.patch_match_worker dense REQUEST.json PARENT` prints what `colmap_worker` does.
"""

from __future__ import annotations

import subprocess
import sys
from typing import Any

from capture.dense.patch_match import PYCOLMAP
from capture.mapping.colmap_worker import Request, print_row, run_step
from estimator.reconstructions.pycolmap_library import pycolmap

#: Longer side in pixels at which depth is computed.
SIDE = 1000
#: A point has to be seen by so many pixels of the depth maps: COLMAP's 5 leaves short videos empty.
LEAST_PIXELS = 3


def dense(request: Request) -> dict[str, Any]:
    """Points that several depth maps agree on, `fused.ply` and `fused.ply.vis` in the workspace.

    How many, and the names of the views by their numbers in the visibility file.
    """
    pycolmap.undistort_images(request["workspace"], request["model"], request["pictures"])
    print_row({"done": 1, "of": 3})
    _stereo(request["workspace"], request["engine"])
    print_row({"done": 2, "of": 3})
    return _fuse(request)


def _stereo(workspace: str, engine: str) -> None:
    """Depth and normal maps of all pictures of the workspace, on the GPU."""
    if engine == PYCOLMAP:
        pycolmap.patch_match_stereo(workspace, options=pycolmap.PatchMatchOptions(max_image_size=SIDE))
        return
    words = [
        engine,
        "patch_match_stereo",
        "--workspace_path",
        workspace,
        "--PatchMatchStereo.max_image_size",
        str(SIDE),
    ]
    subprocess.run(words, check=True, stdout=sys.stderr)


def _fuse(request: Request) -> dict[str, Any]:
    workspace = request["workspace"]
    options = pycolmap.StereoFusionOptions(
        max_image_size=SIDE, min_num_pixels=LEAST_PIXELS, num_threads=request["threads"]
    )
    fused = pycolmap.stereo_fusion(f"{workspace}/fused.ply", workspace, options=options, output_type="ply")
    model = pycolmap.MVSModel()
    model.read(workspace, "COLMAP")
    names = [model.get_image_name(row) for row in range(fused.num_reg_images())]
    return {"points": fused.num_points3D(), "names": names}


if __name__ == "__main__":
    run_step(sys.argv[1:], {"dense": dense})
