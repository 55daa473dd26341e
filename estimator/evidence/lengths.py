"""Known lengths, and baselines between the cameras of a rig, as evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from estimator.evidence.source import silent
from estimator.reconstructions.known_lengths import KnownLength
from estimator.records.scale_evidence import ScaleEvidence
from estimator.records.scene import Scene
from metric_base.arrays import FloatArray
from metric_base.statistics import robust_sigma

if TYPE_CHECKING:
    from estimator.geometry.measurement import Measurements

__all__ = ["RigBaseline", "known_length_evidence"]

#: A rig's baseline is stated to a millimetre or so, and the reconstruction's is no better: natural log.
LEAST_SD = 0.005


def known_length_evidence(lengths: Sequence[KnownLength]) -> tuple[ScaleEvidence, ...]:
    """Each length as evidence without doubt: the user says so. The result says what contradicts it."""
    return tuple(
        ScaleEvidence("known_length", str(number), math.exp(length.log_scale), length.sigma, doubt=0.0)
        for number, length in enumerate(lengths, 1)
    )


@dataclass(frozen=True, slots=True)
class RigBaseline:
    """The distance in metres between two cameras of a rig, such as a stereo pair.

    first, second : folders of the two cameras' pictures, as the model names them (`left/0001.png`,
    `right/0001.png`); pictures of one moment have the same name in both.
    """

    first: str
    second: str
    metres: float

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """The scale by the median distance of the pairs, with the spread of that median."""
        name = f"{self.first} to {self.second}"
        first, second = (_centres(scene, folder) for folder in (self.first, self.second))
        distances = np.array([np.linalg.norm(first[key] - second[key]) for key in sorted(first.keys() & second.keys())])
        if not len(distances):
            return silent("baseline", name, "no two pictures of one moment")
        middle = float(np.median(distances))
        if not middle > 0:
            return silent("baseline", name, "both cameras are at one place")
        spread = robust_sigma(distances) / middle / math.sqrt(len(distances))
        return (ScaleEvidence("baseline", name, self.metres / middle, math.hypot(spread, LEAST_SD)),)


def _centres(scene: Scene, folder: str) -> dict[str, FloatArray]:
    """Camera centres (3,) of the pictures in a folder by their name within it."""
    names = [(PurePosixPath(view.name), view) for view in scene.views]
    return {str(name.relative_to(folder)): view.centre for name, view in names if name.is_relative_to(folder)}
