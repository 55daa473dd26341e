"""The scale that objects are inserted at: stated, or as estimate-scale left it in the folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from estimator.records.digests import masks_digest, model_digest
from estimator.records.result import ScaleResult
from estimator.records.scene import Instance, Scene
from metric_base.errors import InputError, Unquoted, expect, in_file
from metric_base.input_files import read_bytes
from metric_base.records import json_record

#: The major version of a result that is read here.
SCALE_SCHEMA = "metric-tree/scale/1"
#: No scene's unit is smaller in metres, and none is larger than its inverse.
SMALLEST_SCALE = 1e-12
#: Largest result; one of 10,000 objects has some 10 MB.
MAX_RESULT_BYTES = 1 << 27


@dataclass(frozen=True, slots=True)
class MetricScale:
    """metres_per_unit; low, high : its interval, None where none is known; source : `result` or `option`.

    of : sha256 of the model and the masks that a result is of, and `file` where it was read.
    """

    metres_per_unit: float
    low: float | None
    high: float | None
    source: str
    of: Mapping[str, str | None] = field(default_factory=dict)

    def check(self, scene: Scene, masks: Sequence[Instance] | None) -> None:
        """See that the scale is of this scene; masks : those that lie with it, None where others were named.

        Raises
        ------
        InputError
            It is of another reconstruction, or of other masks.
        """
        file = self.of.get("file") or "result"
        if self.of.get("model") not in {None, model_digest(scene)}:
            raise InputError.at(file, "of.model", f"the result of {scene.path}", Unquoted("one of another model"))
        beside = self.of.get("masks_from") == "scene" and masks is not None
        if beside and self.of.get("masks") != masks_digest(scene, masks or ()):
            raise InputError.at(file, "of.masks", f"the result of the masks of {scene.path}", Unquoted("one of others"))

    def doubts(self) -> tuple[str, ...]:
        """What cannot be checked, as sentences: a result of an earlier version does not say what it is of."""
        if self.source != "result" or self.of.get("model"):
            return ()
        name = self.of.get("file") or "the result"
        return (f"{name} does not say which model it is of: see that it is of this scene, or run estimate-scale again",)


class _Interval(msgspec.Struct):
    low: float | None = None
    high: float | None = None


class _Result(msgspec.Struct):
    """What is read of a result of estimate-scale."""

    schema: str
    status: str = ""
    scale: float | None = None
    interval: _Interval | None = None
    of: dict[str, str | None] = {}

    def __post_init__(self) -> None:
        expect(self.schema.startswith(SCALE_SCHEMA), "schema", SCALE_SCHEMA, self.schema)


def scale_of_result(result: ScaleResult) -> MetricScale:
    """The scale of a result of `estimate_scale`. Raises InputError where it has none."""
    if result.scale is None or result.interval is None:
        raise InputError.at("insert_objects", "scale", "a result that has a scale", result.status)
    return MetricScale(result.scale, result.interval.low, result.interval.high, "result", result.of)


def read_scale(folder: Path, stated: float | Path | None) -> MetricScale:
    """The scale that is stated, or that of a result's file, else that of `result.json` in the folder.

    Raises InputError where there is neither, or the result is unresolved.
    """
    if isinstance(stated, float | int):
        if not SMALLEST_SCALE < stated < 1 / SMALLEST_SCALE:
            raise InputError(f"--scale: expected metres per scene unit, above {SMALLEST_SCALE:g}; found {stated}")
        return MetricScale(stated, None, None, "option")
    file = stated or folder / "result.json"
    if not file.is_file():
        how = f"--scale METRES_PER_UNIT, or {file} (estimate-scale {folder} --output {file})"
        raise InputError(f"{folder}: scale: expected {how}; found neither")
    with in_file(file):
        result = json_record(read_bytes(file, limit=MAX_RESULT_BYTES), _Result)
        resolved = result.status in {"resolved", "uncertain"} and result.scale is not None
        expect(resolved, "status", "resolved or uncertain (or state --scale)", result.status)
        interval = result.interval or _Interval()
        for field, value in (("scale", result.scale), ("interval.low", interval.low), ("interval.high", interval.high)):
            sound = value is None or SMALLEST_SCALE < value < 1 / SMALLEST_SCALE
            expect(sound, field, f"metres per unit above {SMALLEST_SCALE:g}", value)
    assert result.scale is not None
    return MetricScale(result.scale, interval.low, interval.high, "result", result.of | {"file": str(file)})
