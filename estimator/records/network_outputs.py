"""Files and conventions of networks that write depths or points with cameras, as found in the code of each project.

Poses are (3, 4) or (4, 4) matrices of cameras with the axes right, down, forward, unless stated otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NetworkOutput:
    """The files of one network. A quantity is the name of an array in `file`, or `FILES:ARRAY` relative to its folder.

    `FILES` may contain `*` (one file for each view, sorted by the numbers in their names) and `{stem}` (name of `file`
    without its suffix). Text files, NPY and zipped EXR have no array name.
    """

    network: str
    files: tuple[str, ...]  #: Patterns of `file`, or of a file with one array, in the folder of the output.
    poses: str
    depth: str = ""  #: (n, h, w) or (n, h, w, 1) along the optical axis; empty if `points` is set.
    points: str = ""  #: (n, h, w, 3) in the world.
    intrinsics: str = ""  #: (n, 3, 3), (3, 3) or (n, 4) fx, fy, cx, cy in pixels of the map; empty: from `points`.
    confidence: str = ""  #: (n, h, w), larger is better; optional.
    is_world_to_camera: bool = False
    images: str = "images"  #: Folder of the images, which the network reads in the order of their names.
    is_metric: bool | None = None  #: Whether its units are metres; None if only some models are metric.


#: facebookresearch/vggt and vggt-omega, demo_gradio.py: `predictions.npz` next to `images/`; normalised units.
VGGT = NetworkOutput(
    "VGGT", ("predictions.npz",), "extrinsic", "depth", "", "intrinsic", "depth_conf", is_world_to_camera=True,
    is_metric=False,
)  # fmt: skip
#: yyfz/Pi3, demo_gradio.py; only Pi3X is metric.
PI3 = NetworkOutput("Pi3", ("predictions.npz",), "camera_poses", points="points", confidence="conf")
#: ByteDance-Seed/Depth-Anything-3, src/depth_anything_3/utils/export/npz.py; `is_metric` is not written.
DEPTH_ANYTHING_3 = NetworkOutput(
    "Depth Anything 3",
    ("results.npz", "exports/npz/results.npz", "exports/mini_npz/results.npz"),
    "extrinsics", "depth", "", "intrinsics", "conf", is_world_to_camera=True,
)  # fmt: skip
#: ByteDance-Seed/Depth-Anything-3, da3_streaming/da3_streaming.py.
DEPTH_ANYTHING_3_STREAMING = NetworkOutput(
    "Depth Anything 3 streaming",
    ("camera_poses.txt",),
    "camera_poses.txt:", "results_output/frame_*.npz:depth", "", "intrinsic.txt:", "results_output/frame_*.npz:conf",
)  # fmt: skip
#: CUT3R/CUT3R, demo.py.
CUT3R = NetworkOutput(
    "CUT3R",
    ("camera/*.npz",),
    "camera/*.npz:pose", "depth/*.npy:", "", "camera/*.npz:intrinsics", "conf/*.npy:", images="color",
    is_metric=True,
)  # fmt: skip
#: nv-tlabs/vipe, vipe/utils/io.py; the images are in a video.
VIPE = NetworkOutput(
    "ViPE", ("pose/*.npz",), "data", "depth/{stem}.zip:", "", "intrinsics/{stem}.npz:data", is_metric=True
)
#: mega-sam/mega-sam, cvd_opt/cvd_opt.py.
MEGASAM = NetworkOutput("MegaSaM", ("*_sgd_cvd_hr.npz",), "cam_c2w", "depths", "", "intrinsic")
NETWORKS = (VGGT, PI3, DEPTH_ANYTHING_3, DEPTH_ANYTHING_3_STREAMING, CUT3R, VIPE, MEGASAM)

#: Names of the depth in an archive of one image, best first; a single array may have any name. `depth_z` is that of
#: MapAnything, `depth` that of Depth Pro and others. `depth_along_ray` is no depth.
DEPTH_KEYS = ("metric_depth", "depth_z", VGGT.depth, MEGASAM.depth, "depth_m", "pred_depth", "prediction")
#: Names of the intrinsics (..., 3, 3) in pixels of the map.
INTRINSICS_KEYS = (DEPTH_ANYTHING_3.intrinsics, VGGT.intrinsics, "K")
#: Names of a focal length in pixels of the map; the first is that of Depth Pro.
FOCAL_KEYS = ("focallength_px", "focal_length_px", "focal")
#: Names of the points (h, w, 3) in an archive of one image, in the frame of the camera: those of MoGe and MapAnything.
POINT_KEYS = (PI3.points, "pts3d_cam")
#: Arrays by which the archives of UniDepth v2 are recognised. The logarithm of the first is the expected absolute error
#: of the depth in metres (ops/losses/confidence.py; its author calls the name wrong in issue 18 of UniK3D). The loss
#: aligns the medians of depth and truth before, so that no error of the scale is stated.
UNIDEPTH_KEYS = ("confidence", "rays")
#: Standard deviation of the log scale that all images of a network share. On ETH3D, the mean relative errors of scale
#: of MapAnything and Pi3X are .16 and .25 (map-anything-ggml); a normal error with this mean has 1.25 times its size.
NETWORK_SD = {"mapanything": 0.20, "pi3x": 0.31}
#: Standard deviation of the log scale of other networks, of which no measurement on unseen scenes is known: that of the
#: worse of these two.
OTHER_NETWORK_SD = 0.31
#: Standard deviation of the log scale of all networks for scenes closer than `MAX_TABLETOP_M`: an object of 9 x 16 cm
#: was 1.8 times too large (Depth-Anything-3, issue 244), and an object of .47 m .58 m long with MASt3R (root mean
#: square of ln 1.8 and ln 1.23).
TABLETOP_SD = 0.44
#: Maximum median depth in metres of a scene on a table.
MAX_TABLETOP_M = 1.0
