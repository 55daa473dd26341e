"""What a COLMAP model's files say, before it is checked and joined into a scene."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.records.scene import Camera
from metric_base.arrays import FloatArray, IntArray

__all__ = ["ColmapImage", "ColmapModel"]


@dataclass(frozen=True, slots=True, eq=False)
class ColmapImage:
    """quaternion : (4,) w x y z, world to camera; keypoints : (m, 2); point_ids : (m,), -1 without a point."""

    id: int
    quaternion: FloatArray
    translation: FloatArray
    camera_id: int
    name: str
    keypoints: FloatArray
    point_ids: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class ColmapModel:
    """cameras by id; images in file order; point_ids : (n,); points : (n, 3)."""

    cameras: dict[int, Camera]
    images: tuple[ColmapImage, ...]
    point_ids: IntArray
    points: FloatArray
