"""The result of an estimate (`ScaleResult`, format `metric-tree/scale/1`, see docs/reference/formats.md) and its parts.

`Curve` is the density over log scale. `ScaleEvidence` is evidence other than objects: a known length, the height of the
camera, GPS, a marker, metric depth. `SceneEstimate` is a result with the scene that it is based on.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal

from estimator.records.objects import Measurements
from estimator.records.scene import Instance, Scene, SceneProblem
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.files import write_whole

#: Prior probability that evidence is wrong, the same as for an object
#: (`posterior.likelihood.OUTLIER_PROBABILITY`).
DOUBT = 0.1
#: Assumption about positions of a table in a local frame.
TAKEN_AS_METRES = "taken as metres"
#: Assumption of a scale by objects alone.
FULL_SIZE = "objects are taken as full-size, not as models or toys"
SCHEMA = "metric-tree/scale/1"
Status = Literal["resolved", "uncertain", "unresolved"]
Verdict = Literal["used", "outlier", "skipped"]
#: Number of significant digits in JSON; the fourth digit of a scale is a hundredth of the narrowest intervals.
DIGITS = 5


@dataclass(frozen=True, slots=True)
class Mode:
    """A local maximum of the posterior."""

    scale: float  #: Metres per unit.
    mass: float  #: Probability of its basin.


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A density over log scale."""

    log_scale: FloatArray  #: (g,)
    density: FloatArray  #: (g,)
    below: float  #: Probability below the grid.
    above: float  #: Probability above the grid.


@dataclass(frozen=True, slots=True)
class ScaleEvidence:
    """One piece of evidence: log scale ~ N(ln `scale`, `sd_log`^2), or the reason why there is none.

    >>> ScaleEvidence("camera_height", "floor", scale=0.5, sd_log=0.1).doubt
    0.1
    """

    kind: str  #: Such as `known_length`, `camera_height`, `gps`, `marker`, `metric_depth` or `baseline`.
    id: str  #: Identifier within its kind.
    scale: float | None  #: Metres per scene unit; None with a reason.
    sd_log: float | None  #: Standard deviation of its natural log; None with a reason.
    doubt: float = DOUBT  #: Probability that it is wrong, 0 if the user states it as certain.
    reason: str | None = None
    assumption: str | None = None  #: Assumption about its unit, stated if no object confirms it.
    place: str | None = None  #: Country or region of its positions (`metric_base.rectangles`).

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
    """Report on one piece of evidence other than objects."""

    kind: str
    id: str
    scale: float | None
    sd_log: float | None
    weight: float  #: Probability that it is right.
    verdict: Literal["used", "outlier", "skipped"]
    reason: str | None


@dataclass(frozen=True, slots=True)
class Interval:
    """Equal-tailed interval of the scale."""

    level: float  #: Its probability.
    low: float  #: Metres per unit.
    high: float  #: Metres per unit.


@dataclass(frozen=True, slots=True)
class UpReport:
    """The vertical of the scene."""

    vector: tuple[float, float, float]  #: Unit vector that points up.
    method: str
    sigma_deg: float  #: Standard deviation of its tilt.


@dataclass(frozen=True, slots=True, eq=False)
class ResultContext:
    """Values of a result that do not depend on the method."""

    up: UpReport | None = None
    problems: tuple[SceneProblem, ...] = ()  #: Of the model, the masks and the vertical, in the order of the stages.
    digests: Mapping[str, str | None] | None = None  #: SHA-256 of the inputs; None for a result without `of`.
    seconds: Mapping[str, float] = field(default_factory=dict)  #: Duration of the earlier stages.


@dataclass(frozen=True, slots=True)
class Alternative:
    """The scale under another assumption (`name`): without one class, or without support planes."""

    name: str
    scale: float
    low: float
    high: float
    objects: int


@dataclass(frozen=True, slots=True)
class Help:
    """A measurement that would narrow the interval."""

    what: str  #: Description for the user.
    object: str | None  #: Category and id of the object.
    narrows_by: float  #: Relative decrease of the log width of the interval.
    option: str | None = None  #: Command-line option that adds the measurement, with METRES for its result.


@dataclass(frozen=True, slots=True)
class ObjectReport:
    """Report on one object."""

    id: str
    category: str
    node: str | None
    points: int
    dimensions: Mapping[str, float]  #: Extents in scene units.
    confidence: Mapping[str, float]
    truncated: tuple[str, ...]
    used: tuple[str, ...]  #: Dimensions that constrain the scale.
    scale: float | None  #: Scale that the object alone indicates.
    weight: float  #: Probability that it matches its label.
    verdict: Verdict
    reason: str | None
    score: float = 1.0
    notes: tuple[str, ...] = ()
    views: int = 0
    tier: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ScaleResult:
    """The scale of a scene."""

    status: Status
    method: str
    scale: float | None
    interval: Interval | None
    modes: tuple[Mode, ...]
    tree: tuple[str, str]
    objects: tuple[ObjectReport, ...]
    up: UpReport | None = None
    warnings: tuple[str, ...] = ()
    without_support: Alternative | None = None
    leave_one_class_out: tuple[Alternative, ...] | None = None
    evidence: tuple[EvidenceReport, ...] = ()
    would_help: tuple[Help, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    of: Mapping[str, str | None] = field(default_factory=dict)  #: SHA-256 of the model, masks and options.
    curve: Curve | None = None  #: For figures.
    object_curves: Mapping[str, FloatArray] = field(default_factory=dict)  #: (g,) densities by object, for figures.

    @property
    def best_scale(self) -> float | None:
        """The scale or, if it is unresolved, the highest mode, for drawings; None without evidence."""
        if self.scale is not None or not self.modes:
            return self.scale
        return self.modes[0].scale

    @property
    def assumption(self) -> str | None:
        """Assumption about the objects, or None if there is no scale or other evidence confirms it."""
        is_by_objects = any(item.verdict == "used" for item in self.objects)
        has_other = any(report.verdict == "used" for report in self.evidence)
        return FULL_SIZE if self.scale is not None and is_by_objects and not has_other else None

    def to_json(self) -> dict[str, Any]:
        """Return the result as a JSON object (`metric-tree/scale/1`)."""
        objects = []
        for item in self.objects:
            metres = None
            if self.scale is not None:
                metres = {name: value * self.scale for name, value in item.dimensions.items()}
            objects.append(_plain(item) | {"dimensions_m": _plain(metres), "weight": round(item.weight, 3)})
        record: dict[str, Any] = {
            "schema": SCHEMA,
            "status": self.status,
            "method": self.method,
            "scale": _plain(self.scale),
            "interval": _plain(self.interval),
            "modes": [_plain(mode) | {"mass": round(mode.mass, 4)} for mode in self.modes],
            "up": self.up and _plain(self.up) | {"sigma_deg": _plain(round(self.up.sigma_deg, 2))},
            "tree": {"name": self.tree[0], "version": self.tree[1]},
            "objects": objects,
            "warnings": list(self.warnings),
            "assumption": self.assumption,
            "seconds": {name: round(value, 4) for name, value in self.seconds.items()},
        }
        if self.of:
            record["of"] = dict(self.of)
        if self.without_support is not None:
            record["without_support"] = _plain(self.without_support)
        if self.leave_one_class_out is not None:
            record["leave_one_class_out"] = _plain(self.leave_one_class_out)
        if self.status != "resolved":
            record["would_help"] = [_plain(item) | {"narrows_by": item.narrows_by} for item in self.would_help]
        if self.evidence:
            record["evidence"] = [_plain(item) | {"weight": round(item.weight, 3)} for item in self.evidence]
        lengths = [item for item in self.evidence if item.kind == "known_length"]
        if lengths:
            record["known_lengths"] = [_plain({"scale": one.scale, "relative_sigma": one.sd_log}) for one in lengths]
        return record

    def json(self) -> str:
        """Return the JSON object as text, with one field per line."""
        return json.dumps(self.to_json(), indent=1, ensure_ascii=False, allow_nan=False)

    def save(self, path: Path, option: str | None = None, schema: str | None = None) -> None:
        """Write the JSON beside `path` and rename it: never half a file.

        `option` and `schema` are those of `metric_base.files.whole_file`, which raises an `InputError` if the system
        cannot write there or the file exists.
        """
        write_whole(path, self.json() + "\n", option, schema)


def _plain(value: Any) -> Any:
    """Return a record or a value for JSON: numbers are rounded to `DIGITS`, and None if they are not finite."""
    if is_dataclass(value):
        return {one.name: _plain(getattr(value, one.name)) for one in fields(value)}
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value


@dataclass(frozen=True, slots=True, eq=False)
class SceneEstimate:
    """The result of a scene, and the scene, instances and measurements that it is based on."""

    result: ScaleResult
    scene: Scene
    instances: tuple[Instance, ...]
    measurements: Measurements | None  #: None for `sucar`, which measures no objects.
