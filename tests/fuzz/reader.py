"""What a reader is, for the fuzzing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Reader"]


@dataclass(frozen=True, slots=True)
class Reader:
    """files : those of a seed folder that are mutated, one at a time; read : reads the folder, or raises.

    alone : whether each file is read for itself; then `read` is given the file in place of the folder.
    """

    name: str
    seed: str
    files: tuple[str, ...]
    read: Callable[[Path, Path], None]
    alone: bool = False
