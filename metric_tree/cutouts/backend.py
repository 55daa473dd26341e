"""Interface of the backends that separate the foreground of an image, and `Auto`, which chooses between two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from metric_base.errors import expect

Point: TypeAlias = tuple[float, float]
RGB: TypeAlias = NDArray[np.uint8]
BackendName: TypeAlias = Literal["auto", "plain", "rembg"]
BACKENDS: tuple[str, ...] = get_args(BackendName)


class Guide(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Position of the object in an image, drawn by a reviewer, and the judgement of the cut-out."""

    picture: str  #: SHA-256 of the image.
    polygon: tuple[Point, ...] = ()
    box: tuple[float, float, float, float] | None = None  #: x, y, width, height in pixels.
    object: tuple[tuple[Point, ...], ...] = ()  #: Strokes on the object.
    ground: tuple[tuple[Point, ...], ...] = ()  #: Strokes on the background.
    reviewer: str
    verdict: Literal["good", "poor"] = "good"
    why: str = ""  #: Reason of a poor verdict.

    def __post_init__(self) -> None:
        expect(len(self.picture) == 64, "picture", "a sha256", self.picture)
        drawn = (len(self.polygon) >= 3) + (self.box is not None)
        expect(drawn == 1 or self.undrawn, "polygon, box", "three points or a box", "neither")
        expect(bool(self.reviewer.strip()), "reviewer", "a name", self.reviewer)
        expect(self.verdict == "good" or bool(self.why), "why", "a reason of a poor cut", self.why)

    @property
    def undrawn(self) -> bool:
        """Return True for a poor verdict without an outline."""
        return self.verdict == "poor" and not self.polygon and self.box is None


@dataclass(frozen=True, slots=True, eq=False)
class Foreground:
    """Foreground of an image."""

    alpha: NDArray[np.uint8]  #: (h, w) opacity, 255 on the object.
    method: str  #: Column `method` of `images.parquet`.
    refused: str | None = None  #: Reason of the backend to reject the mask (`not_plain`, `no_weights`, `poor`).


class Backend(Protocol):
    """A method to separate the foreground of an image."""

    def foreground(self, image: RGB) -> Foreground:
        """Return the foreground of an RGB image, (h, w, 3) uint8."""
        ...


@dataclass(frozen=True, slots=True)
class Settings:
    """Choice of a backend."""

    name: BackendName = "auto"
    model: str = "u2net"  #: Name of a model of rembg, or path of an ONNX file.
    weights: bool = False  #: Whether the weights are available; without them, `auto` rejects other backgrounds.
    drawn: tuple[Guide, ...] = ()  #: Guides, which take precedence in their images.


@dataclass(frozen=True, slots=True)
class Auto:
    """The backend for plain backgrounds, and a network for the others."""

    plain: Backend
    network: Backend | None

    def foreground(self, image: RGB) -> Foreground:
        """Return the foreground of an image (h, w, 3) by `plain` if that does not refuse it, else by the network."""
        plain = self.plain.foreground(image)
        if plain.refused is None:
            return plain
        if self.network is None:
            return Foreground(plain.alpha, plain.method, "no_weights")
        return self.network.foreground(image)
