"""Knowledge about the camera before the mapping."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.projection.cameras import CAMERA_MODELS

#: COLMAP's camera model of an uncorrected wide lens.
FISHEYE = "OPENCV_FISHEYE"


@dataclass(frozen=True, slots=True)
class Lens:
    """Camera model and focal length in pixels of the frames."""

    model: str  #: COLMAP's name.
    focal_px: float | None  #: Focal length, None if unknown.
    fixed: bool  #: Whether the user gave the focal length, which is not refined.
    width: int  #: Of the frames.
    height: int
    free: bool = False  #: Whether the frames share a camera whose model is to be chosen.
    wide_px: float | None = None  #: Focal length of an ideal fisheye lens, if the file states a wide one.

    @property
    def params(self) -> list[float]:
        """Parameters of the camera by the focal length, which is known."""
        assert self.focal_px is not None
        known = {"cx": self.width / 2, "cy": self.height / 2} | dict.fromkeys(("f", "fx", "fy"), self.focal_px)
        return [float(known.get(name, 0.0)) for name in CAMERA_MODELS[self.model][1]]
