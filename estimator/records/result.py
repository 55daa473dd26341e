"""The answer: `metric-tree/scale/1`, as a record that prints, saves and explains itself (docs/reference/formats.md).

A density over log scale, and its modes.

Evidence for the scale beside the objects: a known length, the camera's height, GPS, a marker, metric depth.

An estimate together with the scene, instances and measurements that it came from.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from estimator.records.scene import Instance, Scene, SceneProblem
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.files import whole_file

if TYPE_CHECKING:
    from estimator.records.objects import Measurements

#: Probability that evidence is wrong before the objects are consulted, as for an object
#: (`posterior.likelihood.OUTLIER_PROBABILITY`).
DOUBT = 0.1
SCHEMA = "metric-tree/scale/1"
Status = Literal["resolved", "uncertain", "unresolved"]
Verdict = Literal["used", "outlier", "skipped"]
#: Digits that a reader can use: the fourth of a scale is a hundredth of the best interval met.
DIGITS = 5


@dataclass(frozen=True, slots=True)
class Mode:
    """A local maximum of the posterior: `scale` in metres per unit, the `mass` of its basin."""

    scale: float
    mass: float


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A density over log scale: log_scale (g,), density (g,), and the mass beyond each end of the grid."""

    log_scale: FloatArray
    density: FloatArray
    below: float
    above: float


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


@dataclass(frozen=True, slots=True)
class Interval:
    """Equal-tailed interval of the scale: `level` of the posterior between `low` and `high` metres per unit."""

    level: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class UpReport:
    """The vertical in the scene: unit `vector`, how it was found, one standard deviation in degrees."""

    vector: tuple[float, float, float]
    method: str
    sigma_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class ResultContext:
    """Values of a result that do not depend on the method."""

    up: UpReport | None = None
    problems: tuple[SceneProblem, ...] = ()  #: Of the model, the masks and the vertical, in the order of the stages.
    digests: Mapping[str, str | None] | None = None  #: SHA-256 of the inputs; None for a result without `of`.
    seconds: Mapping[str, float] = field(default_factory=dict)  #: Duration of the earlier stages.


@dataclass(frozen=True, slots=True)
class Alternative:
    """The scale under another assumption (`name`): a class left out, or heights without support planes."""

    name: str
    scale: float
    low: float
    high: float
    objects: int


@dataclass(frozen=True, slots=True)
class Help:
    """A measurement that would help: in words, of which object, and the part of the interval's log width it takes."""

    what: str
    object: str | None
    narrows_by: float


@dataclass(frozen=True, slots=True)
class ObjectReport:
    """One object: its extents in scene units by dimension, what was used, its own scale, and the verdict.

    views : pictures whose masks it was measured from; tier : what the size of its category rests on.
    """

    id: str
    category: str
    node: str | None
    points: int
    dimensions: Mapping[str, float]
    confidence: Mapping[str, float]
    truncated: tuple[str, ...]
    used: tuple[str, ...]
    scale: float | None
    weight: float
    verdict: Verdict
    reason: str | None
    score: float = 1.0
    notes: tuple[str, ...] = ()
    views: int = 0
    tier: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ScaleResult:
    """The scale of a scene; `of` : sha256 of the model, masks and options that it is of.

    `curve` and `object_curves` (id to density over `curve.log_scale`) serve figures only.
    """

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
    of: Mapping[str, str | None] = field(default_factory=dict)
    curve: Curve | None = None
    object_curves: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def best_scale(self) -> float | None:
        """The scale, or of an unresolved one the highest mode, for what is drawn of it; None where nothing spoke."""
        if self.scale is not None or not self.modes:
            return self.scale
        return self.modes[0].scale

    def to_json(self) -> dict[str, Any]:
        """The result as a JSON object (`metric-tree/scale/1`)."""
        record: dict[str, Any] = {
            "schema": SCHEMA,
            "status": self.status,
            "method": self.method,
            "scale": _plain(self.scale),
            "interval": _plain(self.interval),
            "modes": [_plain(mode) | {"mass": round(mode.mass, 4)} for mode in self.modes],
            "up": self.up and _plain(self.up) | {"sigma_deg": _plain(round(self.up.sigma_deg, 2))},
            "tree": {"name": self.tree[0], "version": self.tree[1]},
            "objects": [self._object(item) for item in self.objects],
            "warnings": list(self.warnings),
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
        """The record as text, one field a line."""
        return json.dumps(self.to_json(), indent=1, ensure_ascii=False, allow_nan=False)

    def record(self) -> dict[str, Any]:
        """The old name of `to_json`."""
        warnings.warn("ScaleResult.record is called to_json", DeprecationWarning, stacklevel=2)
        return self.to_json()

    def save(self, path: Path, option: str | None = None, schema: str | None = None) -> None:
        """Write the JSON beside `path` and rename it: never half a file.

        `option` and `schema` are those of `metric_base.files.whole_file`, which raises an `InputError` if the system
        cannot write there or the file exists.
        """
        with whole_file(path, option, schema) as work:
            work.write_text(self.json() + "\n", encoding="utf-8")

    def _object(self, item: ObjectReport) -> dict[str, Any]:
        metres = None
        if self.scale is not None:
            metres = {name: value * self.scale for name, value in item.dimensions.items()}
        row: dict[str, Any] = _plain(item)
        return row | {"dimensions_m": _plain(metres), "weight": round(item.weight, 3)}


def _plain(value: Any) -> Any:
    """A record or a value as JSON has it: numbers rounded to `DIGITS`, None for those that are not finite."""
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
    """The result of a scene and what it came from; `measurements` is None for `sucar`, which measures no object."""

    result: ScaleResult
    scene: Scene
    instances: tuple[Instance, ...]
    measurements: Measurements | None
