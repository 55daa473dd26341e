"""COLMAP's dense reconstruction in a separate process.

`python -m capture.dense.patch_match_worker dense REQUEST.json PARENT` prints the lines of `colmap_worker`.
"""

from __future__ import annotations

import subprocess
import sys
from typing import Any

from capture.dense.patch_match import PYCOLMAP
from capture.mapping.colmap_worker import Request, print_row, run_step
from capture.mapping.features import N_THREADS
from estimator.reconstructions.pycolmap_library import pycolmap

#: Longer side in pixels of a depth map.
DEPTH_SIDE = 1000
#: Minimum number of pixels of depth maps that see a point; COLMAP's 5 leaves short videos empty.
MIN_PIXELS = 3


def dense(request: Request) -> dict[str, Any]:
    """Write `fused.ply` and `fused.ply.vis`, points that several depth maps confirm, to the workspace.

    Returns the number of points, and the names of the views in the order of the visibility file.
    """
    workspace, engine = request["workspace"], request["engine"]
    pycolmap.undistort_images(workspace, request["model"], request["images"])
    print_row({"done": 1, "of": 3})
    if engine == PYCOLMAP:
        pycolmap.patch_match_stereo(workspace, options=pycolmap.PatchMatchOptions(max_image_size=DEPTH_SIDE))
    else:
        side = ["--PatchMatchStereo.max_image_size", str(DEPTH_SIDE)]
        command = [engine, "patch_match_stereo", "--workspace_path", workspace, *side]
        subprocess.run(command, check=True, stdout=sys.stderr)
    print_row({"done": 2, "of": 3})
    options = pycolmap.StereoFusionOptions(max_image_size=DEPTH_SIDE, min_num_pixels=MIN_PIXELS, num_threads=N_THREADS)
    fused = pycolmap.stereo_fusion(f"{workspace}/fused.ply", workspace, options=options, output_type="ply")
    model = pycolmap.MVSModel()
    model.read(workspace, "COLMAP")
    names = [model.get_image_name(row) for row in range(fused.num_reg_images())]
    return {"points": fused.num_points3D(), "names": names}


if __name__ == "__main__":
    run_step(sys.argv[1:], {"dense": dense})
