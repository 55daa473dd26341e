"""Description of a reader for the fuzzing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Reader"]


@dataclass(frozen=True, slots=True)
class Reader:
    """A reader and its files.

    seed : folder of intact files.
    files : patterns of the files that are mutated, one at a time.
    read : function that reads the folder or raises an error; its arguments are the folder and the folder of all seeds.
    alone : whether each file is read separately; `read` then receives the file instead of the folder.
    """

    name: str
    seed: str
    files: tuple[str, ...]
    read: Callable[[Path, Path], None]
    alone: bool = False
