"""The one kind of fault that is the input's and not the program's: commands answer it with one line and exit 2."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self, TypeVar

__all__ = ["FieldFault", "InputFault", "StorageFault", "Words", "at_field", "in_file"]

Name = TypeVar("Name", bound=Path | str)

#: How much of a strange value a fault shows: a line of a terminal, not a page.
MAX_SHOWN = 120
#: The same of what was expected, where names from the file may be quoted.
MAX_EXPECTED = 600


class Words(str):
    """Words about a value, which a fault shows as they are: without quotes, control characters escaped."""

    __slots__ = ()

    def __new__(cls, words: str) -> Self:
        """The words, with control characters escaped."""
        return super().__new__(cls, words.encode("unicode_escape").decode("ascii"))


class InputFault(ValueError):
    """An input is at fault: the message names the file, the field, what was expected and what was found."""

    @classmethod
    def at(cls, file: Path | str, field: str, expected: str, found: object) -> Self:
        """The fault in one line; `found` is shown as Python would write it, or as `Words`, cut to a readable length."""
        shown = found if isinstance(found, Words) else repr(found)
        return cls(f"{file}: {field[:MAX_SHOWN]}: expected {expected[:MAX_EXPECTED]}, found {shown[:MAX_SHOWN]}")


class FieldFault(ValueError):
    """A value is at fault, in a file that only a caller knows: `in_file` makes an `InputFault` of it.

    field : where in the document, as far as is known; it may be empty. expected, found : as of `InputFault.at`.
    """

    def __init__(self, field: str, expected: str, found: object) -> None:
        super().__init__(field, expected, found)
        self.field, self.expected, self.found = field, expected, found

    def __str__(self) -> str:
        """What an `InputFault` says after the file."""
        return f"{self.field}: expected {self.expected}, found {self.found!r}"


class at_field:  # noqa: N801 - a context manager, as those of contextlib
    """Within the block a `FieldFault` gets `field` before its own; a plain class, for it is entered once a record."""

    __slots__ = ("field",)

    def __init__(self, field: str) -> None:
        self.field = field

    def __enter__(self) -> None:
        """Nothing to prepare."""

    def __exit__(self, _kind: type[BaseException] | None, fault: BaseException | None, _trace: object) -> None:
        """Add the field to a fault."""
        if isinstance(fault, FieldFault):
            gap = "" if not self.field or not fault.field or fault.field[0] in ".[" else " "
            raise FieldFault(f"{self.field}{gap}{fault.field}", fault.expected, fault.found) from None


@contextmanager
def in_file(file: Name, kind: type[InputFault] = InputFault) -> Iterator[Name]:
    """Within the block a `FieldFault` becomes a fault of the file, of this kind; the block is given the file.

    `file` is a path, or a path with a line: `decisions.jsonl:12`.
    """
    try:
        yield file
    except FieldFault as fault:
        raise kind.at(file, fault.field or "content", fault.expected, fault.found) from None


class StorageFault(InputFault):
    """Files of a run, or the server that it shares with others, cannot be written or asked."""
