"""TOML files checked against a record of their fields; a fault is one line that names file, field, expected, found."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

import msgspec

from metric_base.faults import InputFault

__all__ = ["BadDeclaration", "expect", "toml_record"]

Record = TypeVar("Record", bound=msgspec.Struct)

_PLACE = re.compile(r" - at `(?:\w+ in )?`?\$\.?([^`]*)`$")
_MISSING = re.compile(r"Object missing required field `(\w+)`")
_UNKNOWN = re.compile(r"Object contains unknown field `(\w+)`")


class BadDeclaration(InputFault):
    """A declaration that is at fault: the message names the file, the field, expected and found."""


def expect(holds: bool, field: str, expected: str, found: object) -> None:
    """Raise a ValueError that names the field unless `holds`; `toml_record` adds the file and the place."""
    if not holds:
        raise ValueError(f"{field}: expected {expected}, found {found!r}")


def toml_record(path: Path, kind: type[Record]) -> Record:
    """The record of a TOML file.

    Raises
    ------
    BadDeclaration
        The file cannot be read or is no TOML; fields are missing (all are named), unknown, or not what they must be.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise BadDeclaration(f"{path}: expected TOML, found: {' '.join(str(error).split())}") from None
    required = [field.name for field in msgspec.structs.fields(kind) if field.required]
    if missing := [name for name in required if name not in values]:
        raise BadDeclaration(f"{path}: expected the fields {', '.join(required)}, found no {', '.join(missing)}")
    try:
        return msgspec.convert(values, kind, dec_hook=_pattern)
    except msgspec.ValidationError as error:
        raise BadDeclaration(f"{path}: {_line(str(error), kind)}") from None


def _line(message: str, kind: type[msgspec.Struct]) -> str:
    """A fault of msgspec in our words: the place first, then what was expected and found."""
    place = match[1] if (match := _PLACE.search(message)) else ""
    said = _PLACE.sub("", message)
    if named := _MISSING.search(said):
        return f"{'.'.join(filter(None, (place, named[1])))}: expected a value, found none"
    if named := _UNKNOWN.search(said):
        return f"{'.'.join(filter(None, (place, named[1])))}: expected a known field, found an unknown one"
    if value := re.fullmatch(r"Invalid enum value (.*)", said):
        words = ", ".join(sorted(_words(kind, re.split(r"[.\]]", place)[-1])))
        return f"{place}: expected one of {words}, found {value[1]}"
    said = re.sub(r"^Expected (.*), got (.*)$", r"expected \1, found \2", said)
    return f"{place}.{said}" if place and re.match(r"\w+:", said) else f"{place}: {said}" if place else said


def _words(kind: type[msgspec.Struct], name: str) -> set[str]:
    """The words that a field of this name may hold, in a record or in the records inside it."""
    words: set[str] = set()
    for field in msgspec.structs.fields(kind):
        parts = (field.type, *get_args(field.type))
        if field.name == name:
            words.update(word for part in parts if get_origin(part) is Literal for word in get_args(part))
        for part in parts:
            if isinstance(part, type) and issubclass(part, msgspec.Struct):
                words |= _words(part, name)
    return words


def _pattern(kind: type, value: Any) -> Any:
    """A regular expression of a text."""
    if "Pattern" not in str(kind) or not isinstance(value, str):
        raise ValueError(f"expected a regular expression, found {value!r}")
    try:
        return re.compile(value, re.IGNORECASE)
    except re.error as error:
        raise ValueError(f"pattern: expected a regular expression, found {value!r}: {error}") from None
