"""COLMAP's dense reconstruction with everything real but the GPU: a program of its name writes true depth instead."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from capture.dense import patch_match
from estimator.outputs.rescaled import write_colmap_model
from estimator.reconstructions.colmap import read_colmap
from estimator.reconstructions.ply import read_dense_cloud
from estimator.records.scene import Camera, Scene, View
from metric_base.arrays import FloatArray
from tests.support.skips import skip_without
from tests.synthetic.rooms.render import NoOpenGL
from tests.synthetic.videos import Lens, SyntheticFrame, orbit, recorded, room

LENS = Lens(240, 180, 190.0)
#: Names whose order is not that of the views.
NAMES = ["d.png", "b.png", "e.png", "a.png", "c.png"]
#: Stand-in for COLMAP: `help`, and depth and normal maps of the workspace's images from arrays next to it.
PROGRAM = """#!{python}
import sys
from pathlib import Path
from typing import Any
import numpy as np

if sys.argv[1] == "help":
    print("COLMAP 4.2.1 (Commit x on y {built} CUDA)")
    sys.exit()
stereo = Path(sys.argv[sys.argv.index("--workspace_path") + 1]) / "stereo"
for picture in (stereo.parent / "images").iterdir():
    maps = np.load(Path(__file__).with_name(picture.name + ".npz"))
    for kind in ("depth", "normal"):
        planes = maps[kind]
        head = f"{{planes.shape[2]}}&{{planes.shape[1]}}&{{planes.shape[0]}}&".encode()
        (stereo / f"{{kind}}_maps" / f"{{picture.name}}.geometric.bin").write_bytes(head + planes.tobytes())
"""


def _rays() -> FloatArray:
    """(h, w, 3) rays of the lens, of depth 1."""
    y, x = np.mgrid[: LENS.height, : LENS.width]
    return np.dstack(
        [(x + 0.5 - LENS.width / 2) / LENS.focal, (y + 0.5 - LENS.height / 2) / LENS.focal, np.ones_like(x)]
    )


def _maps(frame: SyntheticFrame) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Depth (1, h, w) and normals (3, h, w), towards the camera, of a frame."""
    depth = np.nan_to_num(frame.depth, posinf=0).astype(np.float64)
    points = _rays() * depth[:, :, None]
    normal = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
    normal *= np.where((normal * points).sum(axis=2, keepdims=True) > 0, -1, 1)
    return depth[None].astype(np.float32), np.moveaxis(normal, 2, 0).astype(np.float32).copy()


@pytest.fixture(scope="module")
def synthetic(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[SyntheticFrame]]:
    """A COLMAP model of five views in `model`, their images and true maps in `pictures`."""
    folder = tmp_path_factory.mktemp("stereo")
    (folder / "model").mkdir()
    (folder / "pictures").mkdir()
    with skip_without(NoOpenGL):
        frames = list(recorded(room("sitting room", 7, orbit(2.05, len(NAMES), 7, degrees=22.0)), LENS, noise=0.0))
    middle = frames[2]
    local = (_rays() * middle.depth[:, :, None])[2::12, 2::12].reshape(-1, 3)
    points = (local[np.isfinite(local).all(axis=1)] - middle.pose.translation) @ middle.pose.rotation
    camera = Camera("PINHOLE", LENS.width, LENS.height, np.array([190.0, 190.0, 120.0, 90.0]))
    views = []
    for name, frame in zip(NAMES, frames, strict=True):
        cv2.imwrite(str(folder / "pictures" / name), frame.colour[:, :, ::-1])
        depth, normal = _maps(frame)
        np.savez(folder / f"{name}.npz", depth=depth, normal=normal)
        seen = np.arange(len(points))
        views.append(View(name, camera, frame.pose.rotation, frame.pose.translation, np.ones((len(seen), 2)), seen))
    write_colmap_model(Scene(folder, "memory", tuple(views), points), 1.0, folder / "model")
    return folder, frames


@pytest.fixture
def program(synthetic: tuple[Path, list[SyntheticFrame]], monkeypatch: pytest.MonkeyPatch) -> Path:
    """The program, first on the path, on a machine whose CUDA driver answers."""
    file = synthetic[0] / "colmap"
    file.write_text(PROGRAM.format(python=sys.executable, built="with"))
    file.chmod(0o755)
    monkeypatch.setenv("PATH", str(synthetic[0]), prepend=":")
    monkeypatch.setattr(patch_match, "cuda_devices", lambda: 1)
    return file


def test_fused_points_lie_on_the_room_and_name_their_views(
    synthetic: tuple[Path, list[SyntheticFrame]], program: Path, tmp_path: Path
) -> None:
    folder, frames = synthetic
    notices: list[str] = []
    count = patch_match.make_dense_points(
        folder / "model", folder / "pictures", tmp_path / "dense.ply", notice=notices.append
    )
    assert f"by PatchMatch on CUDA ({program})" in notices[0]
    assert {"dense.ply", "dense.ply.vis"} <= {file.name for file in tmp_path.iterdir()}
    assert not list(tmp_path.glob("*.scratch"))
    scene = read_colmap(folder / "model")
    cloud, warnings = read_dense_cloud(tmp_path / "dense.ply", len(scene.views))
    assert (len(cloud.points), warnings) == (count, ())
    assert count > 15_000
    assert cloud.visible_offsets is not None
    assert cloud.visible_views is not None
    owner = np.repeat(np.arange(count), np.diff(cloud.visible_offsets))
    for row, view in enumerate(scene.views):
        sees = owner[cloud.visible_views == row]
        assert len(sees) > 5000
        local = cloud.points[sees] @ view.rotation.T + view.translation
        x, y = (LENS.focal * local[:, :2] / local[:, 2:] + [120, 90]).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < LENS.width) & (y < LENS.height)
        assert inside.mean() > 0.99
        depth = frames[NAMES.index(view.name)].depth[y[inside], x[inside]]
        assert np.median(np.abs(local[inside, 2] / depth - 1)) < 0.003


def test_a_device_that_fails_leaves_the_work_to_the_plane_sweep(
    synthetic: tuple[Path, list[SyntheticFrame]],
    program: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    program.write_text(program.read_text().replace("stereo = ", "sys.exit('out of memory')\nstereo = "))
    monkeypatch.setattr(patch_match, "make_dense_cloud", lambda *_: 7)
    notices: list[str] = []
    words = (synthetic[0] / "model", synthetic[0] / "pictures", tmp_path / "dense.ply")
    assert patch_match.make_dense_points(*words, notice=notices.append) == 7
    assert "PatchMatch failed, and the plane sweep on the CPU is used" in notices[1]


def test_no_device_or_no_build_with_cuda_means_no_patch_match(program: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert patch_match.patch_match_engine() == str(program)
    program.write_text(PROGRAM.format(python=sys.executable, built="without"))
    assert patch_match.patch_match_engine() is None
    monkeypatch.setattr(patch_match, "cuda_devices", lambda: 0)
    assert patch_match.patch_match_engine() is None


@pytest.mark.parametrize(
    ("started", "counted", "n_devices"), [(0, 0, 2), (100, 0, 0), (0, 100, 0)], ids=["devices", "start", "count"]
)
def test_devices_are_counted_by_the_driver(
    started: int, counted: int, n_devices: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Driver:
        """CUDA's driver API, which returns 0 for success."""

        def cuInit(self, _: int) -> int:  # noqa: N802 - the driver's name
            return started

        def cuDeviceGetCount(self, count: Any) -> int:  # noqa: N802 - the driver's name
            count._obj.value = 2
            return counted

    monkeypatch.setattr(patch_match.ctypes, "CDLL", lambda _: Driver())
    assert patch_match.cuda_devices() == n_devices


def test_without_a_driver_there_is_no_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patch_match, "DRIVER", "libno-such-driver.so")
    assert patch_match.cuda_devices() == 0
