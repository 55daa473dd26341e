"""What can be made harder about a synthetic scene, all in one frozen record."""

from __future__ import annotations

from dataclasses import dataclass, replace

__all__ = ["CLUTTERED", "HARD", "Knobs", "with_knobs"]


@dataclass(frozen=True, slots=True)
class Knobs:
    """Every knob of a synthetic scene; the defaults are an ordinary handheld video of an ordinary room.

    objects : keep about this many objects, None for all of the kind's list. coverage : share of the camera path that is
    walked, from its start; at less than 1 some objects are seen from one side only or cut by the border. turn_deg :
    the camera's whole yaw range where it is narrow (straight driving), None for the ordinary path. tilt_deg and
    tilted : angle of the tilted objects and their share. mislabelled : share of objects that bear another category's
    name in every frame. missing_feet : share of objects whose lowest fifth is never reconstructed. depth_noise : one
    sigma of a dense point's depth, relative. keypoint_noise : one sigma of an observation in pixels. stray : share of
    points that lie nowhere. smear : how much of real depth's errors there is, 0 to 1: points between two surfaces at
    outlines, more noise at grazing angles, heavy tails. gloss : share of the floor's points that are mirror images of
    what stands on it. bare_faces : share of the faces of objects that have no texture. mask_error_px : one sigma of the
    masks' border, in pixels. clutter : share of what stands on another object that is in that one's masks and has
    none of its own, as books on a table are. texture : contrast of all textures (1 ordinary). views : frames.
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
                msg = f"{name}: expected a share from 0 to 1, found {getattr(self, name)}"
                raise ValueError(msg)
        if self.views < 2:
            msg = f"views: expected 2 or more, found {self.views}"
            raise ValueError(msg)


#: A hand-held video of an ordinary room whose depth, masks and floor have the errors of real ones.
HARD = Knobs(
    coverage=0.6,
    depth_noise=0.006,
    smear=0.4,
    gloss=0.03,
    bare_faces=0.3,
    mask_error_px=2.0,
    missing_feet=0.15,
)
#: The same, and four of five objects that stand on another one are in that one's masks.
CLUTTERED = replace(HARD, clutter=0.8)


def with_knobs(knobs: Knobs, **changes: float | None) -> Knobs:
    """The same knobs with some changed."""
    return replace(knobs, **changes)  # type: ignore[arg-type]  # field types are checked by the record itself
