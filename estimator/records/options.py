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
    """How to measure objects; `PAPER` has the choices of the paper. The extent rule is the same for all.

    Attributes
    ----------
    association : {"shared", "incremental"}
        See `associate`.
    outliers, robust_footprint
        See `fit_box`.
    supports : bool
        Extend objects down to the plane that they stand on.
    planes_for_up : bool
        Refine the vertical by the level surfaces of the scene.
    dense : bool
        Use the dense cloud.
    cuboids : bool
        Measure objects with boxes or few points by the cuboid that fits their outlines.
    stated_tracks : bool
        Merge masks with one track in the annotation, unless the views contradict it.
    fragments : bool
        Keep objects that are parts of others.
    level_tops : bool
        Measure tables up to their top, without the objects on it.
    standing : callable, optional
        Whether a category stands on the floor (True), hangs (False), or may do either (None); by default
        `estimator.geometry.category_rules.stands`.
    up : sequence of float, optional
        Known vertical.
    """

    association: AssociationMethod = "shared"
    outliers: Literal["neighbours", "forest"] = "neighbours"
    robust_footprint: bool = True
    supports: bool = True
    planes_for_up: bool = True
    dense: bool = True
    cuboids: bool = True
    stated_tracks: bool = True
    fragments: bool = False
    level_tops: bool = True
    standing: Callable[[str], bool | None] | None = None
    up: Sequence[float] | None = None


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
    """What the caller asks of an estimate.

    evidence : beside the objects; trust_known_length : a known length that contradicts the objects is believed;
    up : the vertical in the scene's axes where it is known from outside; where : region and year of the objects, which
    the baselines do not use.
    """

    method: str = "default"
    level: float = 0.9
    evidence: tuple[ScaleEvidence, ...] = ()
    leave_one_class_out: bool = False
    trust_known_length: bool = False
    up: Sequence[float] | None = None
    where: Where | None = None
    paper_lists: Path | None = None  #: Folder of the authors' lists (`scale_metrics`), for the method `paper`.
