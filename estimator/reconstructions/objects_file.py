"""Objects measured elsewhere: the reader of `metric-tree/objects/1` (docs/how-to/scenes.md, `--objects`)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from estimator.reconstructions.checked_files import json_array, json_object, read_json
from estimator.records.measured_object import MeasuredObject
from metric_base.arrays import BoolArray, FloatArray
from metric_base.faults import InputFault, Words
from metric_tree.axes import AXES

__all__ = ["SCHEMA", "STATED_SIGMA", "parse_objects", "read_objects"]

SCHEMA = "metric-tree/objects/1"

#: Standard deviation of a stated extent, natural log, where the file gives no `sigma`: the paper's figures of size
#: noise run from 0 to 15 %, a careful reconstruction is good for 5 %.
STATED_SIGMA = 0.05

#: The paper's threshold of a plausible dimension (section 4.2, example figure). A side of less confidence has an end
#: that is thinly seen, so its extent can only be short: it is read as truncated.
PLAUSIBLE = 0.7

EXTENTS = ("extent1", "extent2", "extent3")


def read_objects(path: Path) -> tuple[MeasuredObject, ...]:
    """The objects of a file, in its order.

    Raises
    ------
    InputFault
        The file cannot be read, or is of another schema, or a field is not what it must be.
    """
    return parse_objects(path, read_json(path))


def parse_objects(path: Path, document: object) -> tuple[MeasuredObject, ...]:
    """The objects of a parsed document; `path` is for messages."""
    record = json_object(path, "document", document)
    if record.get("schema") != SCHEMA:
        raise InputFault.at(path, "schema", SCHEMA, record.get("schema"))
    objects = tuple(
        _object(path, f"objects[{place}]", json_object(path, f"objects[{place}]", entry))
        for place, entry in enumerate(json_array(path, "objects", record.get("objects")))
    )
    seen: set[str] = set()
    for place, item in enumerate(objects):
        if item.id in seen:
            raise InputFault.at(path, f"objects[{place}].id", "an id of its own", item.id)
        seen.add(item.id)
    return objects


def _object(path: Path, field: str, entry: dict[str, Any]) -> MeasuredObject:
    category = entry.get("category")
    if not isinstance(category, str) or not category.strip():
        raise InputFault.at(path, f"{field}.category", "a name", category)
    identity = entry.get("id", field.removeprefix("objects[").removesuffix("]"))
    if isinstance(identity, bool) or not isinstance(identity, str | int):
        raise InputFault.at(path, f"{field}.id", "text or a number", identity)
    free = "dimensions" not in entry
    names = EXTENTS if free else AXES
    extents = _extents(path, field, entry) if free else _by_name(path, f"{field}.dimensions", entry["dimensions"], AXES)
    confidence = _by_name(path, f"{field}.confidence", entry.get("confidence", {}), names, zero=True)
    sigma = _by_name(path, f"{field}.sigma", entry.get("sigma", {}), names)
    sigma = np.where(np.isnan(sigma), STATED_SIGMA, sigma)
    cut = _cut(path, f"{field}.truncated", entry.get("truncated", []), names)
    with np.errstate(invalid="ignore"):
        cut = cut | (confidence < PLAUSIBLE)
    notes: tuple[str, ...] = ()
    if not free and extents[1] > extents[0]:  # `length` is the longer horizontal side
        order = [1, 0, 2]
        extents, sigma, confidence, cut = extents[order], sigma[order], confidence[order], cut[order]
        notes = ("width was longer than length: exchanged",)
    return MeasuredObject(
        id=str(identity),
        category=category,
        extents=extents,
        sigma=sigma,
        confidence=confidence,
        truncated=cut,
        score=_score(path, f"{field}.score", entry.get("score", 1.0)),
        vertical_known=not free,
        notes=notes,
    )


def _extents(path: Path, field: str, entry: dict[str, Any]) -> FloatArray:
    if "extents" not in entry:
        raise InputFault.at(path, f"{field}.dimensions", "dimensions or extents", None)
    values = json_array(path, f"{field}.extents", entry["extents"])
    if not 1 <= len(values) <= 3:
        raise InputFault.at(path, f"{field}.extents", "one to three lengths", Words(f"{len(values)}"))
    lengths = [_length(path, f"{field}.extents[{place}]", value) for place, value in enumerate(values)]
    if lengths != sorted(lengths, reverse=True):
        raise InputFault.at(path, f"{field}.extents", "the longest first", values)
    return np.array(lengths + [math.nan] * (3 - len(lengths)))


def _by_name(path: Path, field: str, value: object, names: Iterable[str], zero: bool = False) -> FloatArray:
    """(3,) numbers by name, NaN where none is given; null counts as not given."""
    given = json_object(path, field, value)
    names = tuple(names)
    for name in given:
        if name not in names:
            raise InputFault.at(path, field, f"some of {', '.join(names)}", name)
    return np.array(
        [_length(path, f"{field}.{n}", given[n], zero) if given.get(n) is not None else math.nan for n in names]
    )


def _length(path: Path, field: str, value: object, zero: bool = False) -> float:
    number = value if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    try:
        number = float(number)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number) or number < 0 or (number == 0 and not zero):
        raise InputFault.at(path, field, "a number of zero or more" if zero else "a positive number", value)
    return number


def _cut(path: Path, field: str, value: object, names: tuple[str, ...]) -> BoolArray:
    given = json_array(path, field, value)
    for name in given:
        if name not in names:
            raise InputFault.at(path, field, f"some of {', '.join(names)}", name)
    return np.array([name in given for name in names])


def _score(path: Path, field: str, value: object) -> float:
    score = 1.0 if value is None else _length(path, field, value, zero=True)
    if score > 1:
        raise InputFault.at(path, field, "a number from 0 to 1", value)
    return score
