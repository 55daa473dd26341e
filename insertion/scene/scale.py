"""The scale of an insertion: stated by the user, or read from a result of `estimate-scale`."""

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

#: Major version of the results that are read.
SCALE_SCHEMA = "metric-tree/scale/1"
#: Minimum metres per unit; the inverse is the maximum.
MIN_SCALE = 1e-12
#: Maximum size of a result file. A result of 10,000 objects has about 10 MB.
MAX_RESULT_BYTES = 1 << 27


@dataclass(frozen=True, slots=True)
class MetricScale:
    """Metres per scene unit, with its interval and origin."""

    metres_per_unit: float
    low: float | None  #: ends of the interval; None if it is not known
    high: float | None
    source: str  #: "result" or "option"
    #: of a result: SHA-256 of the model and of the masks that it was computed from, and the path of its `file`
    of: Mapping[str, str | None] = field(default_factory=dict)

    def check(self, scene: Scene, masks: Sequence[Instance] | None) -> None:
        """Check that the scale was computed from this scene.

        Parameters
        ----------
        scene : Scene
            The reconstruction.
        masks : sequence of Instance or None
            Masks in the folder of the scene; None if the user specified other masks.

        Raises
        ------
        InputError
            The scale was computed from another reconstruction, or from other masks.
        """
        file = self.of.get("file") or "result"
        if self.of.get("model") not in {None, model_digest(scene)}:
            raise InputError.at(file, "of.model", f"the result of {scene.path}", Unquoted("one of another model"))
        has_masks = self.of.get("masks_from") == "scene" and masks is not None
        if has_masks and self.of.get("masks") != masks_digest(scene, masks or ()):
            raise InputError.at(file, "of.masks", f"the result of the masks of {scene.path}", Unquoted("one of others"))

    def warnings(self) -> tuple[str, ...]:
        """Return a warning if a result of an earlier version does not record its model."""
        if self.source != "result" or self.of.get("model"):
            return ()
        name = self.of.get("file") or "the result"
        return (f"{name} does not record its model: check that it is of this scene, or run estimate-scale again",)


class _Interval(msgspec.Struct):
    low: float | None = None
    high: float | None = None


class _Result(msgspec.Struct):
    """Fields of a result of `estimate-scale` that are read."""

    schema: str
    status: str = ""
    scale: float | None = None
    interval: _Interval | None = None
    of: dict[str, str | None] = {}

    def __post_init__(self) -> None:
        expect(self.schema.startswith(SCALE_SCHEMA), "schema", SCALE_SCHEMA, self.schema)


def scale_of_result(result: ScaleResult) -> MetricScale:
    """Return the scale of a result of `estimate_scale`. Raises InputError if it has none."""
    if result.scale is None or result.interval is None:
        raise InputError.at("insert_objects", "scale", "a result that has a scale", result.status)
    return MetricScale(result.scale, result.interval.low, result.interval.high, "result", result.of)


def read_scale(folder: Path, stated: float | Path | None) -> MetricScale:
    """Return the scale of a scene.

    Parameters
    ----------
    folder : Path
        Folder of the scene.
    stated : float, Path or None
        Metres per unit, a result file, or None for `result.json` in the folder.

    Raises
    ------
    InputError
        The file does not exist, or its scale is unresolved.
    """
    if isinstance(stated, float | int):
        if not MIN_SCALE < stated < 1 / MIN_SCALE:
            raise InputError(f"--scale: expected metres per scene unit, above {MIN_SCALE:g}; found {stated}")
        return MetricScale(stated, None, None, "option")
    file = stated or folder / "result.json"
    if not file.is_file():
        how = f"--scale METRES_PER_UNIT, or {file} (estimate-scale {folder} --output {file})"
        raise InputError(f"{folder}: scale: expected {how}; found neither")
    with in_file(file):
        result = json_record(read_bytes(file, limit=MAX_RESULT_BYTES), _Result)
        resolved = result.status in {"resolved", "uncertain"} and result.scale is not None
        expect(resolved, "status", "resolved or uncertain (or specify --scale)", result.status)
        interval = result.interval or _Interval()
        for name, value in (("scale", result.scale), ("interval.low", interval.low), ("interval.high", interval.high)):
            is_valid = value is None or MIN_SCALE < value < 1 / MIN_SCALE
            expect(is_valid, name, f"metres per unit above {MIN_SCALE:g}", value)
    assert result.scale is not None
    return MetricScale(result.scale, interval.low, interval.high, "result", result.of | {"file": str(file)})
