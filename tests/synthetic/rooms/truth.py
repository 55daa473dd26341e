"""What is exactly known of a synthetic scene, in the words of the shared scenes' `truth.json`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from tests.synthetic.rooms.similarity import Similarity
from tests.synthetic.rooms.world import Placed, World

__all__ = ["Truth", "truth_at", "truth_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The truth of a scene.

    metres_per_unit : the scale to be found; up : (3,) in the scene; objects : what was placed, by track; rms_m : how
    well the cameras of the reconstruction fit the true ones, metres (0 where nothing was reconstructed).
    """

    metres_per_unit: float
    up: FloatArray
    objects: dict[str, Placed]
    rms_m: float = 0.0

    def json(self) -> dict[str, Any]:
        """The scene's `truth.json`."""
        return {
            "metres_per_unit": self.metres_per_unit,
            "camera_rms_m": self.rms_m,
            "up_in_scene": [float(v) for v in self.up],
            "objects": [_object(item) for item in self.objects.values()],
        }


def truth_of(world: World, to_scene: Similarity, rms_m: float = 0.0) -> Truth:
    """The truth of a scene whose frame is `to_scene` of the world."""
    return Truth(
        1 / to_scene.scale, to_scene.rotation @ np.array([0.0, 0.0, 1.0]), {t.track: t for t in world.objects}, rms_m
    )


def truth_at(folder: Path, world: World) -> Truth:
    """The truth of a scene on disk that was made of `world`."""
    told = json.loads((folder / "truth.json").read_text())
    entries = {item.track: item for item in world.objects}
    return Truth(told["metres_per_unit"], np.array(told["up_in_scene"]), entries, told["camera_rms_m"])


def _object(item: Placed) -> dict[str, Any]:
    sizes = dict(zip(("length", "width", "height"), (float(v) for v in item.size), strict=True))
    return {
        "track_id": item.track,
        "track_name": item.track,
        "category": item.category,
        "label": item.label,
        "truth_m": {name: {"value": value, "plus_minus": 0.0} for name, value in sizes.items()},
        "tilt_deg": item.tilt_deg,
        "moving": bool(np.any(item.velocity)),
        "stands_on": item.support,
    }
