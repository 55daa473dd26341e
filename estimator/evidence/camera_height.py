"""The height of the camera above the floor, which is typical of hand-held cameras, tripods and cars."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.evidence.source import skipped_evidence
from estimator.records.objects import Measurements
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene, camera_centres
from metric_base.errors import InputError
from metric_base.length_units import metres
from metric_base.statistics import robust_sigma

KIND = "camera_height"

#: Median height of a path above the floor in metres, and its standard deviation.
#: handheld: the mean height of adults is 1.59 m (women) and 1.71 m (men) worldwide (NCD-RisC 2016, standard deviation
#: 0.07 m), and cameras are held between chest and eyes, at 0.75 to 0.94 of it. tripod: photographic tripods are 1.2 to
#: 1.7 m high. car: behind a windscreen (1.2 m) or on a roof (1.7 m).
PRESETS = {"handheld": (1.4, 0.15), "tripod": (1.45, 0.2), "car": (1.45, 0.2)}
#: Range of valid heights in metres, from a microscope to an aeroplane.
MIN_HEIGHT_M = 1e-6
MAX_HEIGHT_M = 1e5
#: Standard deviation of a stated height without one, relative to the height: that of the preset for a held camera.
DEFAULT_LOG_SD = 0.1
#: Standard deviation of the floor, relative to the height of the camera above it.
MIN_LOG_SD = 0.01
#: Fraction of the views at or below the floor from which it is not the floor.
MAX_BELOW_FRACTION = 0.1


@dataclass(frozen=True, slots=True)
class CameraHeight:
    """Median height of the camera above the floor in metres, and its standard deviation."""

    metres: float
    sd: float

    def __post_init__(self) -> None:
        if not (MIN_HEIGHT_M <= self.metres <= MAX_HEIGHT_M and 0 < self.sd < self.metres):
            expected = f"a height of {MIN_HEIGHT_M:g} to {MAX_HEIGHT_M:g} metres with a smaller standard deviation"
            raise InputError.at(KIND, "metres", expected, (self.metres, self.sd))

    @classmethod
    def of(cls, text: str) -> CameraHeight:
        """Parse the name of a preset, or a height such as `1.5+-0.15` or `5ft`.

        >>> CameraHeight.of("1.5+-0.15"), CameraHeight.of("150cm").metres
        (CameraHeight(metres=1.5, sd=0.15), 1.5)
        """
        if text in PRESETS:
            return cls(*PRESETS[text])
        try:
            height, *sd = (metres(part) for part in text.replace("±", "+-").split("+-", 1))
        except ValueError:
            expected = f"HEIGHT or HEIGHT+-SD, as in 1.5+-0.15 or 5ft, or one of {', '.join(PRESETS)}"
            raise InputError.at("--camera-height", "value", expected, text) from None
        return cls(height, sd[0] if sd else DEFAULT_LOG_SD * height)

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:
        """Return the scale by the median height of the cameras above the floor; skipped without a floor."""
        floor = measurements.floor
        if floor is None:
            return skipped_evidence(KIND, "floor", "no floor was found under the cameras")
        heights = camera_centres(scene.views) @ floor.basis[2] - floor.height
        median = float(np.median(heights))
        if not median > 0 or np.mean(heights <= 0) >= MAX_BELOW_FRACTION:
            return skipped_evidence(KIND, "floor", "the cameras are under the lowest plane")
        path_sd = robust_sigma(heights) / median / math.sqrt(len(heights))
        floor_sd = math.hypot(floor.sigma / median / math.sqrt(max(floor.points, 1)), MIN_LOG_SD)
        sd = math.hypot(math.hypot(self.sd / self.metres, path_sd), floor_sd)
        return (ScaleEvidence(KIND, "floor", self.metres / median, sd),)
