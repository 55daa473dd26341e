"""Dense points by plane sweep, held to the depth that the synthetic room was rendered with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from capture.dense import fusion
from capture.dense.fusion import make_dense_cloud
from capture.dense.plane_filling import fill_planes
from capture.dense.plane_sweep import PinholeView
from estimator.reconstructions.ply import read_dense_cloud
from estimator.records.scene import Camera, Scene, View
from metric_base.arrays import FloatArray
from tests.support.skips import skip_without
from tests.synthetic.rooms.render import NoOpenGL
from tests.synthetic.videos import Lens, SyntheticFrame, orbit, recorded, room

LENS = Lens(240, 180, 190.0, k=-0.05)
VIEWS = 5


def _points(frame: SyntheticFrame, step: int) -> FloatArray:
    """World points of every `step`th pixel, by the true depth and the true lens."""
    import zlib  # noqa: F401 - before pycolmap

    import pycolmap

    params = [LENS.focal, LENS.width / 2, LENS.height / 2, LENS.k]
    lens = pycolmap.Camera(model="SIMPLE_RADIAL", width=LENS.width, height=LENS.height, params=params)
    rows, columns = np.mgrid[2 : LENS.height : step, 2 : LENS.width : step]
    rays = np.asarray(lens.cam_from_img(np.column_stack([columns.ravel() + 0.5, rows.ravel() + 0.5])))[:, :2]
    depth = frame.depth[rows.ravel(), columns.ravel()].astype(np.float64)
    local = np.column_stack([rays, np.ones(len(rays))]) * depth[:, None]
    return np.asarray((local - frame.pose.translation) @ frame.pose.rotation)


@pytest.fixture(scope="module")
def synthetic(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Path, list[SyntheticFrame]]:
    """Five views with their true poses, and sparse points from the true depth of the middle one."""
    folder = tmp_path_factory.mktemp("dense")
    with skip_without(NoOpenGL):
        frames = list(recorded(room("sitting room", 7, orbit(2.05, VIEWS, 7, degrees=22.0)), LENS))
    points = _points(frames[2], 12)
    points = points[np.isfinite(points).all(axis=1)]
    camera = Camera(
        "SIMPLE_RADIAL", LENS.width, LENS.height, np.array([LENS.focal, LENS.width / 2, LENS.height / 2, LENS.k])
    )
    views = []
    for k, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"{k}.png"), frame.colour[:, :, ::-1])
        seen = np.arange(len(points))
        pose = frame.pose
        views.append(View(f"{k}.png", camera, pose.rotation, pose.translation, np.zeros((len(seen), 2)), seen))
    return Scene(folder, "memory", tuple(views), points), folder, frames


@pytest.mark.slow
def test_dense_points_lie_on_the_room(synthetic: tuple[Scene, Path, list[SyntheticFrame]]) -> None:
    scene, folder, frames = synthetic
    count = make_dense_cloud(scene, folder, folder / "dense.ply", lambda _done, _of: None)
    assert b"property uchar red" in (folder / "dense.ply").read_bytes()[:200]
    cloud, warnings = read_dense_cloud(folder / "dense.ply", VIEWS)
    assert (len(cloud.points), warnings) == (count, ())
    assert count > 1500
    assert cloud.visible_offsets is not None
    assert cloud.visible_views is not None
    assert np.diff(cloud.visible_offsets).min() >= 3
    middle = frames[2]
    local = cloud.points @ middle.pose.rotation.T + middle.pose.translation
    true = _points(middle, 1) @ middle.pose.rotation.T + middle.pose.translation
    # every dense point that the middle view sees is near the surface there: nearest true point in direction
    from scipy.spatial import KDTree

    sees = np.repeat(np.arange(count), np.diff(cloud.visible_offsets))[cloud.visible_views == 2]
    rays = KDTree(true[:, :2] / true[:, 2:])
    _, nearest = rays.query(local[sees, :2] / local[sees, 2:])
    error = np.abs(local[sees, 2] / true[nearest, 2] - 1)
    assert np.median(error) < 0.006
    assert np.quantile(error, 0.9) < 0.03


def test_views_without_detail_give_no_cloud(
    synthetic: tuple[Scene, Path, list[SyntheticFrame]], tmp_path: Path
) -> None:
    scene, _, _ = synthetic
    small = Camera("PINHOLE", 60, 45, np.array([47.5, 47.5, 30.0, 22.5]))
    scene = replace(scene, views=tuple(replace(view, camera=small) for view in scene.views[1:4]))
    for k in range(VIEWS):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((45, 60, 3), 128, dtype=np.uint8))
    assert make_dense_cloud(scene, tmp_path, tmp_path / "dense.ply", lambda _done, _of: None) == 0
    assert not (tmp_path / "dense.ply").exists()


def _plain_wall(rng: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """True depth and grey levels (120, 160) of a slanted wall that is plain but for a frame of texture."""
    y, x = np.mgrid[:120, :160]
    depth = (1 / (0.3 + 0.001 * x - 0.0005 * y)).astype(np.float32)
    grey = np.full((120, 160), 150.0) + rng.normal(0, 2, (120, 160))
    frame = (x < 20) | (x >= 140) | (y < 15) | (y >= 105)
    return depth, np.where(frame, rng.uniform(0, 255, (120, 160)), grey).astype(np.float32)


def _swept(depth: NDArray[np.float32], grey: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth after a sweep, at pixels with texture."""
    textured = cv2.blur((grey - cv2.blur(grey, (7, 7))) ** 2, (7, 7)) > 100
    return np.where(textured, depth, np.nan).astype(np.float32)


def test_a_plain_surface_is_filled_with_the_plane_around_it() -> None:
    depth, grey = _plain_wall(np.random.default_rng(0))
    filled = fill_planes(_swept(depth, grey), grey)
    assert np.isfinite(filled).all()
    np.testing.assert_allclose(filled, depth, rtol=2e-3)


def test_a_plain_object_in_front_is_not_filled_with_the_wall() -> None:
    """It is as grey as the wall; only its outline has depth."""
    depth, grey = _plain_wall(np.random.default_rng(1))
    inside, outline = np.s_[50:80, 60:110], np.zeros(depth.shape, dtype=bool)
    outline[46:84, 56:114] = True
    outline[inside] = False
    true = depth.copy()
    true[46:84, 56:114] = 1.0
    swept = np.where(outline, true, _swept(depth, grey)).astype(np.float32)
    filled = fill_planes(swept, grey)
    assert not (np.abs(filled[inside] / depth[inside] - 1) < 0.1).any()
    known = np.isfinite(filled)
    assert known.mean() > 0.8
    np.testing.assert_allclose(filled[known], true[known], rtol=2e-3)


def test_a_plain_surface_between_two_planes_stays_empty() -> None:
    depth, grey = _plain_wall(np.random.default_rng(2))
    depth[:, 80:] *= 1.5
    swept = _swept(depth, grey)
    np.testing.assert_array_equal(np.isfinite(fill_planes(swept, grey))[30:90, 75:85], False)


@pytest.mark.parametrize(("n_views", "n_maps"), [(3, 3), (23, 23), (24, 24), (40, 24)])
def test_24_views_have_a_depth_map(n_views: int, n_maps: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    camera = Camera("PINHOLE", 8, 6, np.array([6.0, 6.0, 4.0, 3.0]))
    points = np.array([[0.0, 0, 5], [0.1, 0, 5]])
    seen = np.arange(2)
    views = [
        View(f"{k}", camera, np.eye(3), np.array([0.01 * k, 0, 0]), np.zeros((2, 2)), seen) for k in range(n_views)
    ]
    grey = SimpleNamespace(grey=np.zeros((6, 8), dtype=np.float32))
    monkeypatch.setattr(fusion, "pinhole_view", lambda *_: grey)
    monkeypatch.setattr(fusion, "swept_depth", lambda *_: np.full((6, 8), np.nan, dtype=np.float32))
    monkeypatch.setattr(fusion, "fill_planes", lambda depth, _: depth)
    monkeypatch.setattr(fusion, "fuse_views", lambda *_: (np.empty((0, 3)), None, None))
    done = []
    scene = Scene(tmp_path, "memory", tuple(views), points)
    assert make_dense_cloud(scene, tmp_path, tmp_path / "a.ply", lambda count, of: done.append((count, of))) == 0
    assert done == [(k + 1, n_maps) for k in range(n_maps)]


@pytest.mark.parametrize(("step", "is_filled"), [(0.046, True), (0.054, False)])
def test_a_surface_is_filled_up_to_an_object_five_percent_nearer(step: float, is_filled: bool) -> None:
    """MIN_OBJECT_STEP: the nearest known pixel of a part of the hole is on the object, a twentieth of its border."""
    depth = np.full((60, 60), 2.0, dtype=np.float32)
    depth[20:40, 20:40] = np.nan
    depth[17:20, 28:32] = 2.0 / (1 + step)
    filled = fill_planes(depth, np.full((60, 60), 90.0, dtype=np.float32))
    assert filled[30, 21] == pytest.approx(2.0)
    assert np.isfinite(filled[20, 30]) == is_filled


@pytest.mark.parametrize(
    ("depths", "is_kept"),
    [((1.011, 0.989), True), ((1.011, 0.987), False), ((1.0, np.nan), False), ((1.0,), False)],
)
def test_two_other_views_agree_with_a_dense_depth_within_1_2_percent(depths: tuple[float, ...], is_kept: bool) -> None:
    """All views have the same pose, so that the depths of a pixel are compared directly."""
    shape, matrix = (4, 4), np.array([[10.0, 0, 1.5], [0, 10.0, 1.5], [0, 0, 1.0]])
    view = PinholeView(np.zeros(shape, np.float32), np.zeros((*shape, 3), np.uint8), matrix, np.eye(3), np.zeros(3))
    maps = {row: np.full(shape, depth, np.float32) for row, depth in enumerate((1.0, *depths))}
    points, _, seen = fusion.fuse_views(dict.fromkeys(maps, view), maps)
    assert (len(points) > 0) == is_kept
    assert seen.all()
