"""The words of `--at`, `--on` and `--facing`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from metric_base.errors import InputError

__all__ = ["At", "facing_of", "point_of"]


@dataclass(frozen=True, slots=True)
class At:
    """A point in one picture: its name or number, and the pixel (COLMAP's, from the upper left corner)."""

    frame: str
    x: float
    y: float


def point_of(words: str) -> At | None:
    """`frame=NAME_OR_INDEX,x=PX,y=PX`, or None for `auto`. Raises InputError for anything else."""
    if words == "auto":
        return None
    fields = dict(part.split("=", 1) for part in words.split(",") if "=" in part)
    try:
        x, y = float(fields.get("x", "nan")), float(fields.get("y", "nan"))
    except ValueError:
        x = y = math.nan
    if set(fields) != {"frame", "x", "y"} or not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"--at: expected frame=NAME_OR_INDEX,x=PIXELS,y=PIXELS or auto; found {words!r}")
    return At(fields["frame"], x, y)


def facing_of(words: str) -> float | str:
    """`camera`, `wall`, or degrees turned from the camera. Raises InputError for anything else."""
    if words in ("camera", "wall"):
        return words
    try:
        degrees = float(words)
    except ValueError:
        degrees = math.nan
    if not math.isfinite(degrees):
        raise InputError(f"--facing: expected camera, wall or degrees; found {words!r}")
    return degrees
