"""The spread of the frames' own focal lengths, on synthetic points with a known zoom."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.mapping.pose_refinement import focal_variation
from estimator.projection.cameras import project
from estimator.records.scene import Scene
from tests.synthetic.walk import synthetic_walk


def _seen(scene: Scene, zoom: float, noise_px: float) -> Scene:
    """The scene with observations of a focal length that grows from frame to frame."""
    generator = np.random.default_rng(0)
    views = []
    for view, factor in zip(scene.views, np.geomspace(1.0, 1.0 + zoom, len(scene.views)), strict=True):
        params = view.camera.params.copy()
        params[:2] *= factor
        local = scene.points @ view.rotation.T + view.translation
        pixels = project(replace(view.camera, params=params), local)
        inside = (local[:, 2] > 0) & (pixels >= 0).all(axis=1) & (pixels < (640, 480)).all(axis=1)
        rows = np.flatnonzero(inside)[::6]
        noisy = pixels[rows] + generator.normal(0, noise_px, (len(rows), 2))
        views.append(replace(view, keypoints=noisy, point_index=rows))
    return replace(scene, views=tuple(views))


def test_a_steady_lens_has_none(tmp_path: Path) -> None:
    spread = focal_variation(_seen(synthetic_walk(tmp_path).scene, 0.0, 0.3))
    assert spread is not None
    assert spread < 0.0005


@pytest.mark.parametrize("zoom", [0.05, 0.3])
def test_a_zoom_is_its_spread(tmp_path: Path, zoom: float) -> None:
    scene = synthetic_walk(tmp_path).scene
    true = np.std(np.linspace(0, np.log1p(zoom), len(scene.views)))
    assert focal_variation(_seen(scene, zoom, 0.3)) == pytest.approx(true, rel=0.05)


def test_two_frames_say_nothing(tmp_path: Path) -> None:
    scene = _seen(synthetic_walk(tmp_path).scene, 0.3, 0.3)
    assert focal_variation(replace(scene, views=scene.views[:2])) is None


@pytest.mark.parametrize(("n_points", "is_measured"), [(60, True), (59, False)])
def test_a_frame_needs_sixty_points_in_two_halves(n_points: int, is_measured: bool, tmp_path: Path) -> None:
    scene = _seen(synthetic_walk(tmp_path).scene, 0.0, 0.3)
    views = sorted(scene.views, key=lambda view: -len(view.point_index))[:3]
    few = replace(views[2], keypoints=views[2].keypoints[:n_points], point_index=views[2].point_index[:n_points])
    assert (focal_variation(replace(scene, views=(*views[:2], few))) is not None) == is_measured
