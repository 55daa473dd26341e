"""What is known of the camera before anything is mapped."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.projection.cameras import CAMERA_MODELS

#: COLMAP's camera model of a wide lens that is not corrected.
FISHEYE = "OPENCV_FISHEYE"


@dataclass(frozen=True, slots=True)
class Lens:
    """What is known of the camera: COLMAP's model, and the focal length in pixels of the frames or None.

    fixed : the focal length is given by the user and not refined; width, height : of the frames; rough : the focal
    length is that of the camera's photographs, and its videos may be cropped: a start that is never held; free : the
    frames share a camera whose model the user leaves open; wide_px : the focal length in pixels of an ideal fisheye
    lens, if the file states that the camera has a wide one.
    """

    model: str
    focal_px: float | None
    fixed: bool
    width: int
    height: int
    rough: bool = False
    free: bool = False
    wide_px: float | None = None

    @property
    def params(self) -> str:
        """COLMAP's `camera_params`, empty where the focal length is not known."""
        if self.focal_px is None:
            return ""
        return ",".join(repr(value) for value in self.values)

    @property
    def values(self) -> tuple[float, ...]:
        """The camera's parameters by the focal length alone, which has to be known."""
        assert self.focal_px is not None
        known = {"cx": self.width / 2, "cy": self.height / 2} | dict.fromkeys(("f", "fx", "fy"), self.focal_px)
        return tuple(float(known.get(name, 0.0)) for name in CAMERA_MODELS[self.model][1])


def is_fisheye(model: str) -> bool:
    """Whether a camera model of COLMAP measures angles from the axis, not tangents."""
    return "FISHEYE" in model
