"""Read measured objects of other programs: `metric-tree/objects/1` (docs/reference/formats.md, option `--objects`)."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from estimator.records.objects import ETA_THRESHOLD, MeasuredObject
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted, at_field, expect, in_file
from metric_base.input_files import read_json
from metric_base.parsing import json_array, json_object

SCHEMA = "metric-tree/objects/1"

#: Standard deviation of the log of an extent without `sigma`. The paper evaluates errors of 0 to 15 %; a careful
#: reconstruction has 5 %.
DEFAULT_SIGMA = 0.05

#: Maximum number of objects of a file; each needs about 15 kB, and thousands do not improve the scale.
MAX_OBJECTS = 50_000

_Positive = Annotated[float, msgspec.Meta(gt=1e-300, lt=1e300)]
_Zero = Annotated[float, msgspec.Meta(ge=0, lt=1e300)]


class _Lengths(msgspec.Struct, forbid_unknown_fields=True):
    length: _Positive | None = None
    width: _Positive | None = None
    height: _Positive | None = None


class _Confidence(msgspec.Struct, forbid_unknown_fields=True):
    length: _Zero | None = None
    width: _Zero | None = None
    height: _Zero | None = None


class _FreeLengths(msgspec.Struct, forbid_unknown_fields=True):
    extent1: _Positive | None = None
    extent2: _Positive | None = None
    extent3: _Positive | None = None


class _FreeConfidence(msgspec.Struct, forbid_unknown_fields=True):
    extent1: _Zero | None = None
    extent2: _Zero | None = None
    extent3: _Zero | None = None


class _Entry(msgspec.Struct):
    """Fields of all objects; unknown fields are ignored."""

    category: Annotated[str, msgspec.Meta(pattern=r"\S")]
    id: str | int | None = None
    score: Annotated[float, msgspec.Meta(ge=0, le=1)] | None = None


class _Upright(_Entry, kw_only=True):
    """An object with a known vertical."""

    dimensions: _Lengths
    confidence: _Confidence = msgspec.field(default_factory=_Confidence)
    sigma: _Lengths = msgspec.field(default_factory=_Lengths)
    truncated: list[Literal["length", "width", "height"]] = []


class _Free(_Entry, kw_only=True):
    """An object with sorted extents."""

    extents: Annotated[list[_Positive], msgspec.Meta(min_length=1, max_length=3)]
    confidence: _FreeConfidence = msgspec.field(default_factory=_FreeConfidence)
    sigma: _FreeLengths = msgspec.field(default_factory=_FreeLengths)
    truncated: list[Literal["extent1", "extent2", "extent3"]] = []


#: Expected values of fields, for messages; other fields are lengths.
_EXPECTED = {
    "category": "a name", "id": "text or a number", "extents": "one to three lengths", "truncated": "an array",
    "score": "a number from 0 to 1", "dimensions": "an object", "confidence": "an object", "sigma": "an object",
}  # fmt: skip
_PLACE = re.compile(r" - at `\$(.*)`$")
_NAMED = re.compile(r"(?:missing required|unknown) field `(\w+)`")


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
    if "dimensions" not in record and "extents" not in record and "category" in record:
        raise FieldError(".dimensions", "dimensions or extents", None)
    entry: _Upright | _Free = _convert(record, _Upright if "dimensions" in record else _Free)
    names = entry.sigma.__struct_fields__
    if isinstance(entry, _Free):
        lengths = entry.extents
        expect(all(map(math.isfinite, lengths)), ".extents", "positive numbers", lengths)
        expect(lengths == sorted(lengths, reverse=True), ".extents", "the longest first", lengths)
        extents = np.array(lengths + [math.nan] * (3 - len(lengths)))
    else:
        extents = _numbers(entry.dimensions)
    confidence, sigma = _numbers(entry.confidence), _numbers(entry.sigma)
    sigma = np.where(np.isnan(sigma), DEFAULT_SIGMA, sigma)
    with np.errstate(invalid="ignore"):
        # A side with a low confidence has few points at one end: its extent may be too small.
        truncated = np.array([name in entry.truncated for name in names]) | (confidence < ETA_THRESHOLD)
    notes: tuple[str, ...] = ()
    if isinstance(entry, _Upright) and extents[1] > extents[0]:  # the length is the longer horizontal side
        order = [1, 0, 2]
        extents, sigma, confidence, truncated = extents[order], sigma[order], confidence[order], truncated[order]
        notes = ("width was longer than length: exchanged",)
    return MeasuredObject(
        id=str(index if entry.id is None else entry.id),
        category=entry.category,
        extents=extents,
        sigma=sigma,
        confidence=confidence,
        truncated=truncated,
        score=1.0 if entry.score is None else entry.score,
        vertical_known=isinstance(entry, _Upright),
        notes=notes,
    )


def _convert(record: dict[str, Any], kind: type[_Upright | _Free]) -> _Upright | _Free:
    """Convert a record; FieldError for its first invalid value."""
    try:
        entry = msgspec.convert(record, kind)
    except msgspec.ValidationError as error:
        raise _field_error(record, str(error)) from None
    except UnicodeEncodeError:
        raise FieldError("", "text in Unicode", Unquoted("half of a surrogate pair")) from None
    for field in ("dimensions", "confidence", "sigma"):
        numbers = getattr(entry, field, None)
        for name in () if numbers is None else numbers.__struct_fields__:
            value = getattr(numbers, name)
            if value is not None and math.isnan(value):  # the bounds of a schema accept NaN
                raise FieldError(f".{field}.{name}", "a positive number", value)
    return entry


def _field_error(record: dict[str, Any], message: str) -> FieldError:
    """Convert a message of msgspec to an error with the invalid value."""
    match = _PLACE.search(message)
    field = match[1] if match else ""
    value: Any = record
    for name in re.findall(r"\w+", field):
        value = value[int(name) if isinstance(value, list) else name]
    last = next((name for name in reversed(re.findall(r"\w+", field)) if not name.isdecimal()), "")
    if named := _NAMED.search(message):
        if last:  # an unknown dimension
            return FieldError(field, f"some of {_names(last, record)}", named[1])
        return FieldError(f".{named[1]}", _EXPECTED[named[1]], None)
    if field.endswith("]"):
        expected = f"some of {_names(last, record)}" if last == "truncated" else "a positive number"
    else:
        expected = _EXPECTED.get(last, "a number of zero or more" if "confidence" in field else "a positive number")
    huge = isinstance(value, int) and value.bit_length() > 1000
    return FieldError(field, expected, Unquoted("a number of hundreds of digits") if huge else value)


def _names(field: str, record: dict[str, Any]) -> str:
    """Return the names of the dimensions of an object, for messages."""
    kind = _Lengths if field == "dimensions" or "dimensions" in record else _FreeLengths
    return ", ".join(kind.__struct_fields__)


def _numbers(numbers: msgspec.Struct) -> FloatArray:
    """Return the numbers (3,) of a record; missing ones and null are NaN."""
    values = (getattr(numbers, name) for name in numbers.__struct_fields__)
    return np.array([math.nan if value is None else value for value in values])
