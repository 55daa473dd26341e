"""Errors of invalid input, which commands report in one line with exit status 2."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Generic, Self, TypeVar

Name = TypeVar("Name", bound=Path | str)

#: Maximum number of characters of a found value in a message: one line of a terminal.
MAX_SHOWN = 120
#: Maximum number of characters of an expectation, which may quote names from the file.
MAX_EXPECTED = 600


class Unquoted(str):
    """Words about a value that a message shows without quotes, with control characters escaped."""

    __slots__ = ()

    def __new__(cls, words: str) -> Self:
        """Return the words with control characters escaped."""
        return super().__new__(cls, words.encode("unicode_escape").decode("ascii"))


class InputError(ValueError):
    """An input is invalid: the message states the file, the field, the expected and the found value in one line.

    Attributes
    ----------
    file, field : str or None
        File (a path, perhaps with a line) and field that are invalid, if the error was raised by `at`.
    """

    file: str | None = None
    field: str | None = None

    @classmethod
    def at(cls, file: Path | str, field: str, expected: str, found: object) -> Self:
        """Return the error of a field; `found` is shown by its repr, or as `Unquoted`, cut to a readable length."""
        shown = found if isinstance(found, Unquoted) else repr(found)
        error = cls(f"{file}: {field[:MAX_SHOWN]}: expected {expected[:MAX_EXPECTED]}, found {shown[:MAX_SHOWN]}")
        error.file, error.field = str(file), field
        return error


class UnknownKey(InputError, KeyError):
    """A name that is not known, such as that of a node; unlike a `KeyError`, it is shown without quotes."""

    def __str__(self) -> str:
        return str(self.args[0])


class FieldError(ValueError):
    """A value is invalid in a file that only a caller knows: `in_file` converts this to an `InputError`.

    Parameters
    ----------
    field : str
        Place in the document as far as it is known; it may be empty.
    expected, found
        See `InputError.at`.
    """

    def __init__(self, field: str, expected: str, found: object) -> None:
        super().__init__(field, expected, found)
        self.field, self.expected, self.found = field, expected, found

    def __str__(self) -> str:
        """Return the message of the `InputError` without the file."""
        return f"{self.field}: expected {self.expected}, found {self.found!r}"


def expect(holds: object, field: str, expected: str, found: object) -> None:
    """Raise a `FieldError` unless `holds` is true; `in_file` adds the file."""
    if not holds:
        raise FieldError(field, expected, found)


class at_field:  # noqa: N801 - a context manager, as those of contextlib
    """Put `field` before the field of a `FieldError` of the block; a class, because it is entered once per record."""

    __slots__ = ("field",)

    def __init__(self, field: str) -> None:
        self.field = field

    def __enter__(self) -> None:
        """Enter the block."""

    def __exit__(self, _kind: type[BaseException] | None, error: BaseException | None, _trace: object) -> None:
        """Add the field to the error."""
        if isinstance(error, FieldError):
            gap = "" if not self.field or not error.field or error.field[0] in ".[" else " "
            raise FieldError(f"{self.field}{gap}{error.field}", error.expected, error.found) from None


class in_file(Generic[Name]):  # noqa: N801 - as `at_field`
    """Convert a `FieldError` of the block to an `InputError` of type `kind` that states the file.

    Parameters
    ----------
    file : Path or str
        A path, or a path with a line such as `decisions.jsonl:12`; it is also the value of the `with` statement.
    """

    __slots__ = ("file", "kind")

    def __init__(self, file: Name, kind: type[InputError] = InputError) -> None:
        self.file, self.kind = file, kind

    def __enter__(self) -> Name:
        """Return the file."""
        return self.file

    def __exit__(self, _kind: type[BaseException] | None, error: BaseException | None, _trace: object) -> None:
        """Convert the error."""
        if isinstance(error, FieldError):
            raise self.kind.at(self.file, error.field or "content", error.expected, error.found) from None


def type_and_message(error: Exception) -> str:
    """Return the type of an error with its message, such as `KeyError: 'nodes'`."""
    return f"{type(error).__name__}: {error}"


@contextmanager
def damage_as_field_error(
    expected: str,
    kinds: type[Exception] | tuple[type[Exception], ...] = Exception,
    found: Callable[[Exception], str] = type_and_message,
    *,
    field: str = "content",
) -> Iterator[None]:
    """Convert an error that damaged content causes in the block to a `FieldError`; other errors pass.

    Parameters
    ----------
    expected, field : str
        See `InputError.at`.
    kinds : type or tuple of types, default Exception
        Types that the damage may have. `FieldError` and `InputError` pass in any case, because they state the damage.
    found : callable, default type_and_message
        Return the words about an error.
    """
    try:
        yield
    except (FieldError, InputError):
        raise
    except kinds as error:
        raise FieldError(field, expected, Unquoted(found(error))) from None


class StorageError(InputError):
    """The files of a run, or the server that it shares with others, cannot be read or written."""
