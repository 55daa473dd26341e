"""The one kind of fault that is the input's and not the program's: commands answer it with one line and exit 2."""

from __future__ import annotations

from pathlib import Path
from typing import Self

__all__ = ["InputFault", "Words"]

#: How much of a strange value a fault shows: a line of a terminal, not a page.
MAX_SHOWN = 120


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
        return cls(f"{file}: {field}: expected {expected}, found {shown[:MAX_SHOWN]}")
