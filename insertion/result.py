"""What an insertion did: the record behind `insert-object --json` (metric-tree/insertion/1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from insertion.scene.scale import MetricScale
from metric_base.arrays import FloatArray

SCHEMA = "metric-tree/insertion/1"


@dataclass(frozen=True, slots=True)
class FrameReport:
    """One picture.

    silhouette : x, y, width, height of the object's own pixels, None where it is out of the picture; visible : the
    share of them that nothing hides.
    """

    image: str
    time_s: float | None
    silhouette: tuple[int, int, int, int] | None
    visible: float


@dataclass(frozen=True, slots=True, eq=False)
class InsertionResult:
    """One inserted object."""

    model: str
    scale: MetricScale
    size_m: Mapping[str, float]
    position: FloatArray
    up: FloatArray
    heading_deg: float
    support: str
    frames: tuple[FrameReport, ...]
    seconds: Mapping[str, float]
    warnings: tuple[str, ...] = field(default=())

    def to_json(self) -> dict[str, Any]:
        """The record as it is printed."""
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
            "frames": [_frame(frame) for frame in self.frames],
            "seconds": {name: round(value, 3) for name, value in self.seconds.items()},
            "warnings": list(self.warnings),
        }  # fmt: skip


def _frame(frame: FrameReport) -> dict[str, Any]:
    box = None
    if frame.silhouette is not None:
        box = dict(zip(("x", "y", "width", "height"), frame.silhouette, strict=True))
    return {"image": frame.image, "time_s": frame.time_s, "silhouette": box, "visible": round(frame.visible, 4)}
