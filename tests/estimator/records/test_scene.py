"""Records of a scene are checked where data enter."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from estimator.records.scene import Camera, DenseCloud, Scene, View
from metric_base.errors import InputError

CAMERA = Camera("PINHOLE", 4, 3, np.ones(4))


def _view(turn: tuple[int, ...] = (3, 3), shift: tuple[int, ...] = (3,), n_points: int = 2, point: int = 0) -> View:
    return View("a.png", CAMERA, np.ones(turn), np.ones(shift), np.ones((2, 2)), np.full(n_points, point))


def _scene(points: tuple[int, ...] = (2, 3), point: int = 0) -> Scene:
    return Scene(Path("folder"), "memory", (_view(point=point),), np.ones(points))


RECORDS: list[tuple[Callable[[], object], str | None]] = [
    (lambda: Camera("PINHOLE", 1, 1, np.ones(4)), None),
    (lambda: Camera("PINHOLE", 0, 1, np.ones(4)), "camera: size"),
    (lambda: Camera("PINHOLE", 1, 0, np.ones(4)), "camera: size"),
    (lambda: Camera("PINHOLE", 1, 1, np.ones((1, 4))), "camera: params"),
    (lambda: Camera("PINHOLE", 1, 1, np.array([1.0, np.nan])), "camera: params"),
    (_view, None),
    (lambda: _view(turn=(3, 4)), "view 'a.png': pose"),
    (lambda: _view(shift=(3, 1)), "view 'a.png': pose"),
    (lambda: _view(n_points=3), "view 'a.png': keypoints"),
    (lambda: DenseCloud(np.ones((2, 3)), np.zeros(3, dtype=int)), None),
    (lambda: DenseCloud(np.ones((2, 4))), "dense cloud: points"),
    (lambda: DenseCloud(np.ones(3)), "dense cloud: points"),
    (lambda: DenseCloud(np.ones((2, 3)), np.zeros(2, dtype=int)), "dense cloud: visible_offsets: expected 3 rows"),
    (lambda: _scene(point=1), None),
    (lambda: _scene(points=(2, 2)), "folder: points"),
    (lambda: _scene(points=(6,)), "folder: points"),
    (lambda: _scene(point=2), "folder: view 'a.png': expected rows of 2 points, found rows 2 to 2"),
    (lambda: _scene(point=-1), "folder: view 'a.png'"),
]


@pytest.mark.parametrize(("make", "message"), RECORDS)
def test_a_record_has_its_shapes(make: Callable[[], object], message: str | None) -> None:
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        make()
