"""The named ways in which a capture cannot be used, each with what to record instead."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["CODES", "TYPICAL_FOCAL", "CaptureFailure", "Failure", "after_all", "failure"]

#: Focal length over the longer side before anything is known: a telephone's main camera while recording. Its 24 to 28
#: mm (of 35 mm film) are 0.69 to 0.81 of the longer side of a photograph, and a video is cropped by a tenth or so.
TYPICAL_FOCAL = 0.85

#: What to do, by code; the message of a failure says first what was seen.
ADVICE = {
    "pure_rotation": "walk sideways or around the objects while recording; turning on the spot shows no depth",
    "static_camera": "move the camera: walk around the objects, at least a step to each side",
    "no_texture": "record objects with visible detail, in good light; plain walls and floors cannot be matched",
    "too_few_frames": "record ten seconds or more, or take twenty pictures, each overlapping the next by two thirds",
    "motion_blur": "move more slowly, hold the camera steadily, and use more light",
    "several_places": "record one place in one go, without cuts, and come back over what was seen before",
    "drift": "record a loop that comes back to its start, sideways rather than straight ahead, and more slowly",
    "implausible_focal_length": "give the focal length with --focal, do not zoom, and walk around the objects",
    "focal_length_changes": "do not zoom or let the telephone change lenses, and keep what moves out of the picture",
    "focal_length_undetermined": "walk around the objects or turn the camera as you walk, or give the focal length in "
    f"pixels with --focal (a telephone's main camera: about {TYPICAL_FOCAL} times the longer side of the picture)",
    "out_of_time": "give more time with --max-time, or use fewer frames with --frames",
}
CODES = tuple(ADVICE)


@dataclass(frozen=True, slots=True)
class Failure:
    """A code (docs/how-to/scale-from-a-video.md lists them), and one line for a person."""

    code: str
    message: str

    def json(self) -> dict[str, str]:
        """The `failure` object of the result."""
        return {"code": self.code, "message": self.message}


class CaptureFailure(Exception):
    """A capture that cannot be used."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.message)
        self.failure = failure


def failure(code: str, seen: str) -> Failure:
    """The failure with what was seen and what to do about it."""
    return Failure(code, f"{seen}; {ADVICE[code]}")


def after_all(seen: Failure, tried: list[str], left: list[str]) -> Failure:
    """The failure, which says what was tried where that was more than one way, and what the time did not suffice for.

    >>> after_all(Failure("drift", "walk on"), ["SIFT", "fine SIFT"], ["pooled SIFT"]).message
    'walk on (tried: SIFT; fine SIFT; left for lack of time, see --max-time: pooled SIFT)'
    """
    if len(tried) < 2 and not left:
        return seen
    words = [f"tried: {'; '.join(tried)}"] if tried else []
    words += [f"left for lack of time, see --max-time: {'; '.join(left)}"] if left else []
    return Failure(seen.code, f"{seen.message} ({'; '.join(words)})")
