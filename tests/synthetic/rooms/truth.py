"""Ground truth of a synthetic scene, in the format of `truth.json`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from tests.synthetic.rooms.similarity import Similarity
from tests.synthetic.rooms.world import Placed, World

__all__ = ["Truth", "truth_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Ground truth of a scene.

    metres_per_unit : true scale.
    up : (3,) up vector in the scene.
    objects : objects of the world by track.
    rms_m : RMS distance of the reconstructed cameras from the true ones in metres; 0 without reconstruction.
    """

    metres_per_unit: float
    up: FloatArray
    objects: dict[str, Placed]
    rms_m: float = 0.0

    def json(self) -> dict[str, Any]:
        """Return the content of `truth.json`."""
        return {
            "metres_per_unit": self.metres_per_unit,
            "camera_rms_m": self.rms_m,
            "up_in_scene": [float(v) for v in self.up],
            "objects": [_object(item) for item in self.objects.values()],
        }


def truth_of(world: World, to_scene: Similarity, rms_m: float = 0.0) -> Truth:
    """Return the truth of a scene that is the world transformed by `to_scene`."""
    return Truth(
        1 / to_scene.scale, to_scene.rotation @ np.array([0.0, 0.0, 1.0]), {t.track: t for t in world.objects}, rms_m
    )


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
