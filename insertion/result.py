"""Results of an insertion, as `insert-object --json` prints them (metric-tree/insertion/1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from insertion.scene.scale import MetricScale
from metric_base.arrays import FloatArray

SCHEMA = "metric-tree/insertion/1"


@dataclass(frozen=True, slots=True)
class FrameReport:
    """One object in one frame."""

    image: str  #: name of the frame
    time_s: float | None
    silhouette: tuple[int, int, int, int] | None  #: x, y, width, height in pixels; None if it is out of the frame
    visible: float  #: fraction of its pixels that are not occluded

    def to_json(self) -> dict[str, Any]:
        """Return the JSON record."""
        box = None
        if self.silhouette is not None:
            box = dict(zip(("x", "y", "width", "height"), self.silhouette, strict=True))
        return {"image": self.image, "time_s": self.time_s, "silhouette": box, "visible": round(self.visible, 4)}


@dataclass(frozen=True, slots=True, eq=False)
class InsertionResult:
    """One inserted object."""

    model: str
    scale: MetricScale
    size_m: Mapping[str, float]  #: length, width and height
    position: FloatArray  #: (3,) bottom centre in the scene
    up: FloatArray  #: (3,) unit vector
    heading_deg: float
    support: str
    frames: tuple[FrameReport, ...]
    seconds: Mapping[str, float]  #: time of each stage
    warnings: tuple[str, ...] = field(default=())

    def to_json(self) -> dict[str, Any]:
        """Return the JSON record."""
        scale = self.scale
        return {
            "schema": SCHEMA,
            "model": self.model,
            "scale": {
                "metres_per_unit": scale.metres_per_unit, "low": scale.low, "high": scale.high, "source": scale.source,
            },
            "size_m": dict(self.size_m),
            "size_units": {name: value / scale.metres_per_unit for name, value in self.size_m.items()},
            "place": {
                "position": [float(v) for v in self.position],
                "up": [float(v) for v in self.up],
                "heading_deg": self.heading_deg,
                "support": self.support,
            },
            "frames": [frame.to_json() for frame in self.frames],
            "seconds": {name: round(value, 3) for name, value in self.seconds.items()},
            "warnings": list(self.warnings),
        }  # fmt: skip
