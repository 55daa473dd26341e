"""What cuts: the one protocol, and `auto`, which takes the cheapest that will do."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from metric_base.errors import expect

Point = tuple[float, float]
RGB = NDArray[np.uint8]
BackendName = Literal["auto", "plain", "rembg"]
BACKENDS: tuple[str, ...] = get_args(BackendName)


class Guide(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the object is in one image, by whom, and what the reviewer judges of the cut."""

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
        """Return True if its reviewer found nothing in the image to draw round."""
        return self.verdict == "poor" and not self.polygon and self.box is None


@dataclass(frozen=True, slots=True, eq=False)
class Foreground:
    """What a backend found.

    alpha : (h, w) uint8, 255 on the object; method : how, as it stands in `images.parquet`; refused : why the backend
    itself does not vouch for it (`not_plain`, `no_weights`), else None.
    """

    alpha: NDArray[np.uint8]
    method: str
    refused: str | None = None


class Backend(Protocol):
    """Anything that separates the foreground of an image."""

    def foreground(self, picture: RGB) -> Foreground:
        """The foreground of an image, (h, w, 3) uint8 in RGB."""
        ...


@dataclass(frozen=True, slots=True)
class Settings:
    """A backend by name and the network it takes: a rembg model's name or the path of an ONNX file.

    weights : whether the network's weights are available; without them `auto` leaves what is not plain; drawn : guides
    of persons, which say of their images where the object is.
    """

    name: BackendName = "auto"
    model: str = "u2net"
    weights: bool = False
    drawn: tuple[Guide, ...] = ()


@dataclass(frozen=True, slots=True)
class Auto:
    """Without weights where the background is plain, by the network elsewhere."""

    plain: Backend
    network: Backend | None

    def foreground(self, picture: RGB) -> Foreground:
        """The foreground of an image (h, w, 3): the plain backend's if that vouches for it, else the network's."""
        plain = self.plain.foreground(picture)
        if plain.refused is None:
            return plain
        if self.network is None:
            return Foreground(plain.alpha, plain.method, "no_weights")
        return self.network.foreground(picture)
