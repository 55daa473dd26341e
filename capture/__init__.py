"""A video or a folder of images to a reconstruction with the pose of every frame, in a work folder that resumes."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from capture.mapping.refusals import CaptureFailure
    from capture.pipeline import Capture, capture_video

__all__ = ["Capture", "CaptureFailure", "capture_video"]

#: Module of each public name, imported on first use, so that light commands stay light.
_HOMES = {
    "Capture": "capture.pipeline",
    "CaptureFailure": "capture.mapping.refusals",
    "capture_video": "capture.pipeline",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
