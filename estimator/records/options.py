"""Options of an estimate and of the measurement of objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from estimator.records.result import ScaleEvidence
from metric_tree.context import Where

AssociationMethod = Literal["shared", "incremental"]


@dataclass(frozen=True, slots=True)
class MeasurementOptions:
    """How to measure objects; `PAPER` has the choices of the paper. The extent rule is the same for all."""

    association: AssociationMethod = "shared"  #: See `association.tracks`.
    outliers: Literal["neighbours", "forest"] = "neighbours"  #: See `geometry.box.fit_box`.
    robust_footprint: bool = True  #: See `geometry.box.fit_box`.
    supports: bool = True  #: Extend objects down to the plane that they stand on.
    planes_for_up: bool = True  #: Refine the vertical by the level surfaces of the scene.
    dense: bool = True  #: Use the dense cloud.
    cuboids: bool = True  #: Measure objects with boxes or few points by the cuboid that fits their outlines.
    stated_tracks: bool = True  #: Merge masks with one track in the annotation, unless the views contradict it.
    fragments: bool = False  #: Keep objects that are parts of others.
    level_tops: bool = True  #: Measure tables up to their top, without the objects on it.
    #: Whether a category stands on the floor (True), hangs (False), or may do either (None); by default
    #: `geometry.category_rules.stands_on_floor`.
    standing: Callable[[str], bool | None] | None = None
    up: Sequence[float] | None = None  #: Known vertical.


PAPER = MeasurementOptions(
    "incremental",
    "forest",
    robust_footprint=False,
    supports=False,
    planes_for_up=False,
    cuboids=False,
    stated_tracks=False,
    fragments=True,
    level_tops=False,
)


@dataclass(frozen=True, slots=True)
class EstimateOptions:
    """Options of an estimate."""

    method: str = "default"  #: One of `estimator.records.METHODS`.
    level: float = 0.9  #: Mass of the interval.
    evidence: tuple[ScaleEvidence, ...] = ()  #: Evidence other than objects.
    leave_one_class_out: bool = False  #: Also estimate the scale without each class in turn.
    trust_known_length: bool = False  #: Use a known length that contradicts the objects.
    up: Sequence[float] | None = None  #: Known vertical in the axes of the scene.
    where: Where | None = None  #: Region and year of the objects; not used by the baselines.
    paper_lists: Path | None = None  #: Folder of the authors' lists (`scale_metrics`), for the method `paper`.
