"""Dense points by plane sweep, held to the depth that the made room was rendered with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator.capture.dense.dense_cloud import make_dense_cloud
from estimator.reconstructions.ply import read_dense_cloud
from estimator.records.scene import Camera, Scene, View
from metric_base.arrays import FloatArray
from tests.made.rooms.render import NoOpenGL
from tests.made.videos import Lens, MadeFrame, filmed, orbit, room

LENS = Lens(240, 180, 190.0, k=-0.05)
VIEWS = 5


def _points(frame: MadeFrame, step: int) -> FloatArray:
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
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Path, list[MadeFrame]]:
    """Five views with their true poses, and sparse points from the true depth of the middle one."""
    folder = tmp_path_factory.mktemp("dense")
    try:
        frames = list(filmed(room("sitting room", 7, orbit(2.05, VIEWS, 7, degrees=22.0)), LENS))
    except NoOpenGL as fault:
        pytest.skip(str(fault))
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


def test_dense_points_lie_on_the_room(made: tuple[Scene, Path, list[MadeFrame]]) -> None:
    scene, folder, frames = made
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


def test_views_without_detail_give_no_cloud(made: tuple[Scene, Path, list[MadeFrame]], tmp_path: Path) -> None:
    scene, _, _ = made
    scene = replace(scene, views=scene.views[1:4])
    for k in range(VIEWS):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((LENS.height, LENS.width, 3), 128, dtype=np.uint8))
    assert make_dense_cloud(scene, tmp_path, tmp_path / "dense.ply", lambda _done, _of: None) == 0
    assert not (tmp_path / "dense.ply").exists()
