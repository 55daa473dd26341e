"""A video or a folder of images to a reconstruction with the pose of every frame, in a work folder that resumes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from metric_base.lazy_names import lazy_names

if TYPE_CHECKING:
    from capture.mapping.refusals import CaptureFailure as CaptureFailure
    from capture.pipeline import Capture as Capture
    from capture.pipeline import capture_video as capture_video

#: Module of each public name, imported on first use, so that light commands stay light.
__getattr__, __dir__, __all__ = lazy_names(
    __name__, {"pipeline": ("Capture", "capture_video"), "mapping.refusals": ("CaptureFailure",)}
)
