"""A walk through a synthetic hall: cameras at a known height over a floor, with points on the floor and on objects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.records.scene import Camera, Scene, View
from metric_base.arrays import FloatArray

__all__ = ["Walk", "synthetic_walk", "with_rig"]

CAMERA = Camera("PINHOLE", 640, 480, np.array([500.0, 500.0, 320.0, 240.0]))


@dataclass(frozen=True)
class Walk:
    """Synthetic scene with its ground truth.

    scene : in units of `scale` metres, rotated by `frame` (3, 3) and moved by `offset` (3,) units.
    metres : (n, 3) true camera centres, with z up from the floor.
    scale : true metres per unit.
    """

    scene: Scene
    metres: FloatArray
    scale: float
    frame: FloatArray
    offset: FloatArray

    def units(self, metres: FloatArray) -> FloatArray:
        """Transform points (n, 3) of the hall in metres to the scene."""
        return np.asarray((metres / self.scale) @ self.frame.T + self.offset)


def synthetic_walk(path: Path, height: float = 1.5, scale: float = 0.4, views: int = 24, seed: int = 0) -> Walk:
    """Return a walk on a circle of 3 m around the centre of the hall, with cameras that look inwards and down."""
    generator = np.random.default_rng(seed)
    floor = np.column_stack([generator.uniform(-4, 4, (3000, 2)), generator.normal(0, 0.004, 3000)])
    objects = np.column_stack([generator.uniform(-0.8, 0.8, (900, 2)), generator.uniform(0, 0.9, 900)])
    points = np.concatenate([floor, objects])
    turns = np.linspace(0, 2 * np.pi, views, endpoint=False)
    bob = generator.normal(0, 0.02, views)
    centres = np.column_stack([3 * np.cos(turns), 3 * np.sin(turns), height + bob])
    frame, _ = np.linalg.qr(generator.standard_normal((3, 3)))
    frame *= np.sign(np.linalg.det(frame))
    offset = generator.uniform(-5, 5, 3)
    poses = tuple(_view(f"left/{row:04d}.png", centre, frame, offset, scale) for row, centre in enumerate(centres))
    moved = (points / scale) @ frame.T + offset
    return Walk(Scene(path, "memory", poses, moved, model_path=path), centres, scale, frame, offset)


def with_rig(walk: Walk, baseline: float) -> Walk:
    """Return the walk with a second camera, `baseline` metres to the right of the first (`right/0000.png`, ...)."""
    shifted = []
    for view in walk.scene.views:
        centre = view.centre + baseline / walk.scale * view.rotation[0]
        shifted.append(replace(view, name=view.name.replace("left", "right"), translation=-view.rotation @ centre))
    right = np.array([view.centre for view in shifted])
    metres = (right - walk.offset) @ walk.frame * walk.scale
    scene = replace(walk.scene, views=(*walk.scene.views, *shifted))
    return replace(walk, scene=scene, metres=np.concatenate([walk.metres, metres]))


def _view(name: str, centre: FloatArray, frame: FloatArray, offset: FloatArray, scale: float) -> View:
    ahead = np.array([0, 0, 0.3]) - centre
    z = ahead / np.linalg.norm(ahead)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    rotation = np.array([x, np.cross(z, x), z]) @ frame.T
    position = (centre / scale) @ frame.T + offset
    return View(name, CAMERA, rotation, -rotation @ position, np.zeros((0, 2)), np.zeros(0, dtype=np.int64))
