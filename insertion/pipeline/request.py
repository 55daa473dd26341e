"""What the caller asks for: one object, its size, its place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from insertion.placement.place import At

__all__ = ["ObjectRequest"]


@dataclass(frozen=True, slots=True)
class ObjectRequest:
    """One object.

    model : its file; size : the words of `--size`; at : a point in a picture; on : a category; plane and xy_m : a plane
    and metres along its axes from its middle; without any of these, free space. facing : `camera`, `wall` or degrees;
    category : for `--size prior`.
    """

    model: Path
    size: str = "file"
    at: At | None = None
    on: str | None = None
    plane: int | None = None
    xy_m: tuple[float, float] = (0.0, 0.0)
    facing: float | str = "camera"
    category: str | None = None
