"""An estimate together with the scene, instances and measurements that it came from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from estimator.records.result import ScaleResult
from estimator.records.scene import Instance, Scene

if TYPE_CHECKING:
    from estimator.geometry.measurement import Measurements

__all__ = ["SceneEstimate"]


@dataclass(frozen=True, slots=True, eq=False)
class SceneEstimate:
    """The result of a scene and what it came from; `measurements` is None for `sucar`, which measures no object."""

    result: ScaleResult
    scene: Scene
    instances: tuple[Instance, ...]
    measurements: Measurements | None
