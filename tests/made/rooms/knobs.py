"""What can be made harder about a made scene, all in one frozen record."""

from __future__ import annotations

from dataclasses import dataclass, replace

__all__ = ["Knobs", "with_knobs"]


@dataclass(frozen=True, slots=True)
class Knobs:
    """Every knob of a made scene; the defaults are an ordinary handheld video of an ordinary room.

    objects : keep about this many objects, None for all of the kind's list. coverage : share of the camera path that is
    walked, from its start; at less than 1 some objects are seen from one side only or cut by the border. turn_deg :
    the camera's whole yaw range where it is narrow (straight driving), None for the ordinary path. tilt_deg and
    tilted : angle of the tilted objects and their share. mislabelled : share of objects that bear another category's
    name in every frame. missing_feet : share of objects whose lowest fifth is never reconstructed. depth_noise : one
    sigma of a dense point's depth, relative. keypoint_noise : one sigma of an observation in pixels. stray : share of
    points that lie nowhere. texture : contrast of all textures (1 ordinary). views : frames.
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
    texture: float = 1.0
    views: int = 24

    def __post_init__(self) -> None:
        for name in ("coverage", "tilted", "mislabelled", "missing_feet", "stray"):
            if not 0 <= getattr(self, name) <= 1:
                msg = f"{name}: expected a share from 0 to 1, found {getattr(self, name)}"
                raise ValueError(msg)
        if self.views < 2:
            msg = f"views: expected 2 or more, found {self.views}"
            raise ValueError(msg)


def with_knobs(knobs: Knobs, **changes: float | None) -> Knobs:
    """The same knobs with some changed."""
    return replace(knobs, **changes)  # type: ignore[arg-type]  # field types are checked by the record itself
