"""Guides for cutting pictures, drawn by a person: where the object is.

A file of guides has one JSON object a line: `picture` (sha256), one of `polygon` ([[x, y], ...]) and `box` ([x, y,
width, height]), and `object` and `ground` (strokes, lists of points), in pixels of the upright picture; `verdict` is
what its reviewer judges of the cut: `good`, or `poor` with `why`. A poor one needs no outline: no object is whole.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Literal

import msgspec

from metric_base.records import expect, json_lines

__all__ = ["Guide", "guides"]

Point = tuple[float, float]


class Guide(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the object is in one picture, by whom, and what the reviewer judges of the cut."""

    picture: str
    polygon: tuple[Point, ...] = ()
    box: tuple[float, float, float, float] | None = None
    object: tuple[tuple[Point, ...], ...] = ()
    ground: tuple[tuple[Point, ...], ...] = ()
    reviewer: str
    verdict: Literal["good", "poor"] = "good"
    why: str = ""
    #: The old name of `object`, read for one release.
    thing: tuple[tuple[Point, ...], ...] = ()

    def __post_init__(self) -> None:
        if self.thing:
            warnings.warn("the field 'thing' of a guide is called 'object'", DeprecationWarning, stacklevel=2)
            msgspec.structs.force_setattr(self, "object", self.object + self.thing)
        expect(len(self.picture) == 64, "picture", "a sha256", self.picture)
        drawn = (len(self.polygon) >= 3) + (self.box is not None)
        expect(drawn == 1 or self.undrawn, "polygon, box", "three points or a box", "neither")
        expect(bool(self.reviewer.strip()), "reviewer", "a name", self.reviewer)
        expect(self.verdict == "good" or bool(self.why), "why", "a reason of a poor cut", self.why)

    @property
    def undrawn(self) -> bool:
        """Whether its reviewer found nothing in the picture to draw round."""
        return self.verdict == "poor" and not self.polygon and self.box is None


def guides(path: Path) -> dict[str, Guide]:
    """The guides of a file by picture; a later one replaces an earlier one.

    Raises
    ------
    InputError
        A line is no guide; the message names file, line and field.
    """
    return {guide.picture: guide for _, guide in json_lines(path, Guide)}
