"""The one kind of error that is the input's and not the program's: commands answer it with one line and exit 2."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self, TypeVar

Name = TypeVar("Name", bound=Path | str)

#: How much of a strange value an error shows: a line of a terminal, not a page.
MAX_SHOWN = 120
#: The same of what was expected, where names from the file may be quoted.
MAX_EXPECTED = 600


class Unquoted(str):
    """Unquoted about a value, which an error shows as they are: without quotes, control characters escaped."""

    __slots__ = ()

    def __new__(cls, words: str) -> Self:
        """The words, with control characters escaped."""
        return super().__new__(cls, words.encode("unicode_escape").decode("ascii"))


class InputError(ValueError):
    """An input is invalid: the message names the file, the field, what was expected and what was found."""

    @classmethod
    def at(cls, file: Path | str, field: str, expected: str, found: object) -> Self:
        """The error in one line; `found` is shown by its repr, or as `Unquoted`, cut to a readable length."""
        shown = found if isinstance(found, Unquoted) else repr(found)
        return cls(f"{file}: {field[:MAX_SHOWN]}: expected {expected[:MAX_EXPECTED]}, found {shown[:MAX_SHOWN]}")


class FieldError(ValueError):
    """A value is invalid, in a file that only a caller knows: `in_file` makes an `InputError` of it.

    field : where in the document, as far as is known; it may be empty. expected, found : as of `InputError.at`.
    """

    def __init__(self, field: str, expected: str, found: object) -> None:
        super().__init__(field, expected, found)
        self.field, self.expected, self.found = field, expected, found

    def __str__(self) -> str:
        """What an `InputError` says after the file."""
        return f"{self.field}: expected {self.expected}, found {self.found!r}"


def expect(holds: bool, field: str, expected: str, found: object) -> None:
    """Raise a `FieldError` unless `holds`; whoever knows the file adds it (`in_file`)."""
    if not holds:
        raise FieldError(field, expected, found)


class at_field:  # noqa: N801 - a context manager, as those of contextlib
    """Within the block a `FieldError` gets `field` before its own; a plain class, for it is entered once a record."""

    __slots__ = ("field",)

    def __init__(self, field: str) -> None:
        self.field = field

    def __enter__(self) -> None:
        """Nothing to prepare."""

    def __exit__(self, _kind: type[BaseException] | None, error: BaseException | None, _trace: object) -> None:
        """Add the field to an error."""
        if isinstance(error, FieldError):
            gap = "" if not self.field or not error.field or error.field[0] in ".[" else " "
            raise FieldError(f"{self.field}{gap}{error.field}", error.expected, error.found) from None


@contextmanager
def in_file(file: Name, kind: type[InputError] = InputError) -> Iterator[Name]:
    """Within the block a `FieldError` becomes an error of the file, of this kind; the block is given the file.

    `file` is a path, or a path with a line: `decisions.jsonl:12`.
    """
    try:
        yield file
    except FieldError as error:
        raise kind.at(file, error.field or "content", error.expected, error.found) from None


class StorageError(InputError):
    """Files of a run, or the server that it shares with others, cannot be written or asked."""
