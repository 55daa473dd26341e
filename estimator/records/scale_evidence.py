"""Evidence for the scale beside the objects: a known length, the camera's height, GPS, a marker, metric depth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from metric_base.errors import InputError

__all__ = ["DOUBT", "EvidenceReport", "ScaleEvidence"]

#: Probability that evidence is wrong before the objects are consulted, as for an object
#: (`posterior.likelihood.OUTLIER_SHARE`).
DOUBT = 0.1


@dataclass(frozen=True, slots=True)
class ScaleEvidence:
    """What one piece of evidence says: log scale ~ N(ln `scale`, `sd_log`^2), or why it says nothing.

    kind : such as `known_length`, `camera_height`, `gps`, `marker`, `metric_depth`, `baseline`; id : which of its kind;
    scale : metres per scene unit, sd_log : its standard deviation, natural log; both None where `reason` says why it
    could not speak. doubt : probability that it is wrong altogether, 0 for what the user states as certain.

    >>> ScaleEvidence("camera_height", "floor", scale=0.5, sd_log=0.1).doubt
    0.1
    """

    kind: str
    id: str
    scale: float | None
    sd_log: float | None
    doubt: float = DOUBT
    reason: str | None = None

    def __post_init__(self) -> None:
        if (self.scale is None or self.sd_log is None) != (self.reason is not None):
            raise InputError.at(f"evidence {self.kind}", self.id, "a scale with its sd_log, or a reason", self.scale)
        if self.scale is not None and not (0 < self.scale < math.inf):
            raise InputError.at(f"evidence {self.kind}", self.id, "a positive scale", self.scale)
        if self.sd_log is not None and not (0 < self.sd_log < math.inf):
            raise InputError.at(f"evidence {self.kind}", self.id, "a positive sd_log", self.sd_log)
        if not 0 <= self.doubt < 1:
            raise InputError.at(f"evidence {self.kind}", self.id, "a doubt of at least 0, below 1", self.doubt)


@dataclass(frozen=True, slots=True)
class EvidenceReport:
    """A row of the result: the evidence, the probability that it is right, and the verdict with its reason."""

    kind: str
    id: str
    scale: float | None
    sd_log: float | None
    weight: float
    verdict: Literal["used", "outlier", "skipped"]
    reason: str | None
