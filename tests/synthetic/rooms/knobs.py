"""Parameters of the difficulty of a synthetic scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

__all__ = ["CLUTTERED", "HARD", "Knobs", "with_knobs"]


@dataclass(frozen=True, slots=True)
class Knobs:
    """Parameters of a synthetic scene; the defaults are a hand-held video of an ordinary room.

    objects : maximum number of objects; None: all furniture of the kind of room.
    coverage : fraction of the camera path, from its start. Below 1, some objects are visible from one side only or
        truncated by the border.
    turn_deg : yaw range of the camera if it is narrow (straight driving); None: the ordinary path.
    tilt_deg, tilted : angle of the tilted objects, and their fraction.
    mislabelled : fraction of objects with a wrong label in all frames.
    missing_feet : fraction of objects without points on their lowest fifth.
    depth_noise : relative standard deviation of the depth of a dense point.
    keypoint_noise : standard deviation of an observation in pixels.
    stray : fraction of points at random depths.
    smear : amount of typical depth errors, 0 to 1: points between two surfaces at outlines, more noise at grazing
        angles, heavy tails.
    gloss : fraction of the floor's points that are mirror images of objects on the floor.
    bare_faces : fraction of the objects' faces without texture.
    mask_error_px : standard deviation of the masks' borders in pixels.
    clutter : fraction of the objects on top of others that are included in the mask of the supporting object and have
        no separate mask, such as books on a table.
    texture : contrast of all textures; 1 is ordinary.
    views : number of frames.
    """

    objects: int | None = None
    coverage: float = 1.0
    turn_deg: float | None = None
    tilt_deg: float = 0.0
    tilted: float = 0.0
    mislabelled: float = 0.0
    missing_feet: float = 0.0
    depth_noise: float = 0.004
    keypoint_noise: float = 0.5
    stray: float = 0.01
    smear: float = 0.0
    gloss: float = 0.0
    bare_faces: float = 0.0
    mask_error_px: float = 0.0
    clutter: float = 0.0
    texture: float = 1.0
    views: int = 24

    def __post_init__(self) -> None:
        for name in (
            "coverage",
            "tilted",
            "mislabelled",
            "missing_feet",
            "stray",
            "smear",
            "gloss",
            "bare_faces",
            "clutter",
        ):
            if not 0 <= getattr(self, name) <= 1:
                msg = f"{name}: expected a fraction from 0 to 1; found {getattr(self, name)}"
                raise ValueError(msg)
        if self.views < 2:
            msg = f"views: expected 2 or more; found {self.views}"
            raise ValueError(msg)


#: A hand-held video of an ordinary room with typical errors of depth and masks and a glossy floor.
HARD = Knobs(
    coverage=0.6,
    depth_noise=0.006,
    smear=0.4,
    gloss=0.03,
    bare_faces=0.3,
    mask_error_px=2.0,
    missing_feet=0.15,
)
#: As HARD, with 80 % of the objects on top of others included in the masks of the supporting objects.
CLUTTERED = replace(HARD, clutter=0.8)


def with_knobs(knobs: Knobs, **changes: float | None) -> Knobs:
    """Return the parameters with some changes."""
    return replace(knobs, **changes)  # type: ignore[arg-type]  # the values have different types
