"""Read measured objects of other programs: `metric-tree/objects/1` (docs/reference/formats.md, option `--objects`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.records.objects import ETA_THRESHOLD, MeasuredObject
from metric_base.arrays import FloatArray
from metric_base.errors import at_field, expect, in_file
from metric_base.input_files import read_json
from metric_base.parsing import json_array, json_name, json_object
from metric_tree.axes import AXES, EXTENTS

SCHEMA = "metric-tree/objects/1"

#: Standard deviation of the log of an extent without `sigma`. The paper evaluates errors of 0 to 15 %; a careful
#: reconstruction has 5 %.
DEFAULT_SIGMA = 0.05

#: Maximum number of objects of a file; each needs about 15 kB, and thousands do not improve the scale.
MAX_OBJECTS = 50_000

#: Minimum of a length, and exclusive maximum: 64-bit floats end at 1e308.
MIN_LENGTH, MAX_LENGTH = 1e-300, 1e300


def read_objects(path: Path) -> tuple[MeasuredObject, ...]:
    """Read the objects of a file.

    Raises
    ------
    InputError
        The file cannot be read, has another schema, or a field is invalid.
    """
    return parse_objects(path, read_json(path))


def parse_objects(path: Path, document: object) -> tuple[MeasuredObject, ...]:
    """Return the objects of a parsed document; `path` is used in messages."""
    with in_file(path):
        record = json_object(document)
        expect(record.get("schema") == SCHEMA, "schema", SCHEMA, record.get("schema"))
        objects = []
        ids: set[str] = set()
        entries = json_array(record.get("objects"), "objects")
        expect(len(entries) <= MAX_OBJECTS, "objects", f"at most {MAX_OBJECTS:,}", len(entries))
        for index, entry in enumerate(entries):
            with at_field(f"objects[{index}]"):
                item = _object(index, json_object(entry, ""))
                expect(item.id not in ids, ".id", "a unique id", item.id)
            ids.add(item.id)
            objects.append(item)
    return tuple(objects)


def _object(index: int, record: dict[str, Any]) -> MeasuredObject:
    """Return an object; its position `index` is its default id."""
    category = json_name(record.get("category"), ".category")
    expect("dimensions" in record or "extents" in record, ".dimensions", "dimensions or extents", None)
    is_upright = "dimensions" in record
    names = AXES if is_upright else EXTENTS
    if is_upright:
        extents = _numbers(record, "dimensions", names)
    else:
        lengths = json_array(record["extents"], ".extents")
        expect(0 < len(lengths) <= len(names), ".extents", "one to three lengths", lengths)
        for row, length in enumerate(lengths):
            expect(_is_number(length, MIN_LENGTH), f".extents[{row}]", "a positive number", length)
        expect(lengths == sorted(lengths, reverse=True), ".extents", "the longest first", lengths)
        extents = np.array(lengths + [math.nan] * (len(names) - len(lengths)), dtype=np.float64)
    confidence, sigma = _numbers(record, "confidence", names, may_be_zero=True), _numbers(record, "sigma", names)
    sigma = np.where(np.isnan(sigma), DEFAULT_SIGMA, sigma)
    stated = json_array(record.get("truncated", []), ".truncated")
    for row, name in enumerate(stated):
        expect(name in names, f".truncated[{row}]", f"some of {', '.join(names)}", name)
    with np.errstate(invalid="ignore"):
        # A side with a low confidence has few points at one end: its extent may be too small.
        truncated = np.array([name in stated for name in names]) | (confidence < ETA_THRESHOLD)
    notes: tuple[str, ...] = ()
    if is_upright and extents[1] > extents[0]:  # the length is the longer horizontal side
        order = [1, 0, 2]
        extents, sigma, confidence, truncated = extents[order], sigma[order], confidence[order], truncated[order]
        notes = ("width was longer than length: exchanged",)
    identity, score = record.get("id"), record.get("score")
    is_name = isinstance(identity, str | int | None) and not isinstance(identity, bool)
    expect(is_name, ".id", "text or a number", identity)
    expect(score is None or (_is_number(score) and score <= 1), ".score", "a number from 0 to 1", score)
    return MeasuredObject(
        id=str(index if identity is None else identity),
        category=category,
        extents=extents,
        sigma=sigma,
        confidence=confidence,
        truncated=truncated,
        score=1.0 if score is None else float(score),
        vertical_known=is_upright,
        notes=notes,
    )


def _numbers(record: dict[str, Any], field: str, names: Sequence[str], *, may_be_zero: bool = False) -> FloatArray:
    """Return the numbers (3,) of an object by the names of its dimensions; missing ones and null are NaN."""
    stated = json_object(record.get(field, {}), f".{field}")
    unknown = next((name for name in stated if name not in names), None)
    expect(unknown is None, f".{field}", f"some of {', '.join(names)}", unknown)
    expected = "a number of zero or more" if may_be_zero else "a positive number"
    for name, value in stated.items():
        is_valid = value is None or _is_number(value, 0.0 if may_be_zero else MIN_LENGTH)
        expect(is_valid, f".{field}.{name}", expected, value)
    return np.array([stated.get(name) for name in names], dtype=np.float64)


def _is_number(value: object, low: float = 0.0) -> bool:
    """Return True for a number from `low` up to, but without, `MAX_LENGTH`."""
    return isinstance(value, int | float) and not isinstance(value, bool) and low <= value < MAX_LENGTH
