"""The camera's height above the floor, as a person holds it or a car carries it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimator.evidence.source import silent
from estimator.geometry.planes import floor_of
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene
from metric_base.errors import InputError
from metric_base.statistics import robust_sigma

if TYPE_CHECKING:
    from estimator.records.objects import Measurements

KIND = "camera_height"

#: Metres above the floor and their standard deviation, for a path's median.
#: handheld: adults are 1.59 m (women) and 1.71 m (men) tall in the world's mean (NCD-RisC 2016, spread 0.07), and hold
#: a camera between chest and eyes, 0.75 to 0.94 of that. tripod: photographic tripods raise a camera to 1.2 to 1.7 m.
#: car: behind a windscreen (1.2 m) or on a roof (1.7 m).
PRESETS = {"handheld": (1.4, 0.15), "tripod": (1.45, 0.2), "car": (1.45, 0.2)}

#: Heights that are believed: from a microscope to an aeroplane.
LOWEST_M, HIGHEST_M = 1e-6, 1e5

#: The floor that the planes found is no better than this share of the camera's height over it.
LEAST_SD = 0.01

#: Views of which this share or more are at or under the floor say that it is not the floor.
MOST_UNDER = 0.1


@dataclass(frozen=True, slots=True)
class CameraHeight:
    """Metres of the camera above the floor, as the median over the path, and one standard deviation."""

    metres: float
    sd: float

    def __post_init__(self) -> None:
        if not (LOWEST_M <= self.metres <= HIGHEST_M and 0 < self.sd < self.metres):
            expected = f"a height of {LOWEST_M:g} to {HIGHEST_M:g} metres with a smaller standard deviation"
            raise InputError.at(KIND, "metres", expected, (self.metres, self.sd))

    @classmethod
    def of(cls, text: str) -> CameraHeight:
        """The height of a preset's name, or of `1.5+-0.15`.

        >>> CameraHeight.of("1.5+-0.15")
        CameraHeight(metres=1.5, sd=0.15)
        """
        if text in PRESETS:
            return cls(*PRESETS[text])
        try:
            metres, sd = (float(part) for part in text.replace("±", "+-").split("+-"))
        except ValueError:
            expected = f"METRES+-SD, or one of {', '.join(PRESETS)}"
            raise InputError.at("--camera-height", "value", expected, text) from None
        return cls(metres, sd)

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:
        """The scale by the median height of the cameras over the floor; silent where no floor was found."""
        points = scene.points if scene.dense is None else scene.dense.points
        floor = floor_of(measurements.planes, points)
        if floor is None:
            return silent(KIND, "floor", "no floor was found under the cameras")
        heights = np.array([view.centre for view in scene.views]) @ floor.basis[2] - floor.height
        middle = float(np.median(heights))
        if not middle > 0 or np.mean(heights <= 0) >= MOST_UNDER:
            return silent(KIND, "floor", "the cameras are under the lowest plane")
        path = robust_sigma(heights) / middle / math.sqrt(len(heights))
        own = math.hypot(floor.sigma / middle / math.sqrt(max(floor.points, 1)), LEAST_SD)
        sd = math.hypot(math.hypot(self.sd / self.metres, path), own)
        return (ScaleEvidence(KIND, "floor", self.metres / middle, sd),)
