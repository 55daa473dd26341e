"""When a capture cannot be used: the first named failure that the evidence shows, or none.

The named ways in which a capture cannot be used, each with what to record instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from capture.mapping.match_graph import CaptureEvidence
from capture.mapping.model_metrics import ModelShape

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
#: Five frames of a room gave two placed images, or a focal length that was wrong by a tenth.
LEAST_FRAMES = 6
#: A picture that nowhere moves by more than this share of its side was taken from one place. On a tripod it moves by
#: 0.000; thirty steps ahead through a wide lens (`walk_carpark`) by 0.015, far and near features together.
STATIC_SHARE = 0.005
#: Features a frame below which a picture has nothing to match; an ordinary one has a thousand.
LEAST_KEYPOINTS = 150
#: Steepness of edges below which frames are smeared, in the least and in the most steep direction: sharp rooms
#: measure 0.19 and 0.22, smeared over a fortieth of the width 0.10 and 0.17, a plain room 0.02 and 0.35.
SMEARED = (0.12, 0.19)
#: Share of the moving pairs that a rotation explains: a turn on the spot 0.99, a walk through a room below 0.05.
ROTATION_SHARE = 0.6
#: More than this share of the frames must belong together and be placed; the others are named.
PLACED_SHARE = 0.5
#: Widest angle between two views of a point, median, below which depth is guessed.
LEAST_ANGLE_DEG = 1.5
#: Focal length over the longer side: 0.3 is 118 degrees across, as an action camera has, 8 a long telephoto lens.
FOCAL_RANGE = (0.3, 8.0)
#: A stated focal length widens that range to itself and so much more: what it is stated of may be cropped.
STATED_MARGIN = 1.25
#: `focal_deviation` from which the video does not determine the focal length. Synthetic videos of 320 pixels: walks
#: round objects 0.008 to 0.009, straight ahead or sideways with a hand that sways by 2 degrees 0.02, by 0.3 degrees
#: 0.07, with none 0.5 and more. The errors are as large: 0.003, 0.01, 0.07, and 0.4 to 0.8.
UNDETERMINED = 0.1
#: `focal_spread` from which a video was zoomed. Videos without a zoom have 0.0007 at most, real hand-held ones 0.001; a
#: zoom of 15 % has 0.0096, and its shared focal length is wrong by 16 %.
ZOOMED = 0.006
#: `focal_spread` from which the result says so. With all furniture moving by 3 cm a frame it is 0.0039, and the focal
#: length is wrong by 12 %; by 1 cm 0.0020, and by 3 %. Of 68 right models of real sets and their parts 40 have more
#: than 0.0015, which was the limit, and 6 more than this.
UNSTEADY = 0.0035
#: `focal_deviation` from which the result says so, and how many times it the focal length is about wrong by: of the
#: models of real sets and their parts the 14 over it are off by 7 % (root mean square; 15 % at most) where it is 3.4 %
#: on average; those below by 3 % at most, but for `snow_walk` (5 %).
UNSURE, FOCAL_ERROR_TIMES = 0.02, 2.0
#: ... up to which another lens may mend a refusal for it: of several trials one may pass by chance.
MENDABLE = 0.05
#: A lens that moves the corners by more than this share of the side was invented to explain a wrong focal length.
MOST_BEND = 0.2
#: Pixels of a camera are square; fitted ones differ by up to 3 %. A fisheye lens that was fitted to thirty frames of a
#: walk (`snow_walk`) through an ordinary one had pixels 25 % wider than high, and its path was 17 % off; one of a
#: straight drive, whose focal length nothing decides, 6 %.
MOST_ASPECT = 1.05
#: `residual_pattern` from which other camera models are tried: a wide lens under SIMPLE_RADIAL 0.16, telephones 0.02.
PATTERN = 0.06
#: ... and from which the result says so: the right model leaves up to 0.09 in short rendered videos of few frames.
DOUBTFUL_PATTERN = 0.12
#: Failures that a wrong camera model may explain.
OF_THE_LENS = frozenset(
    {"too_few_frames", "implausible_focal_length", "focal_length_changes", "focal_length_undetermined", "drift"}
)
#: A model that more than this share of the triplets contradict is wrong. On the matches of `lund_street` seven models
#: within 1.4 % of the reference's path had none above 2 px, three that were 50 to 70 % off had 33 to 74 %.
MOST_CONTRADICTED = 0.05
#: ... as is one with so many frames at which the size of its steps breaks; one may be chance. A walk of 158 frames
#: (`walk_carpark`), of which 25 in the middle came out four times too large, had six; 55 right ones of real sets none.
LEAST_BROKEN = 2
#: Median angle, and share of the frames that triplets hold together, from which the other mapper is not asked ...
RELIABLE_ANGLE_DEG, HELD_SHARE = 3.0, 0.8
#: ... if the frames are at most so many steps of matches apart. Without a loop, what a path drifts by grows with them.
MOST_STEPS = 6
#: Share of the frames from which a model that can be used ends the search; of smaller ones the largest is taken.
WHOLE_SHARE = 0.8
#: Points over the weakest seam from which a dispute of the mappers does not count. The depth of one, over small steps,
#: is known to a third or so, and so the size of what they hold to 6 %. Disputed paths of three parts of `snow_walk` had
#: 2, 2 and 15, and the third was 7.6 % off; those of other sets had 39 and more, and were right.
LEAST_SEAM = 30
#: Camera centres of two mappers differ by this share of the path where the path is not settled; ordinary rooms 0.001.
MOST_DISAGREEMENT = 0.05


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


def early_failure(evidence: CaptureEvidence) -> Failure | None:
    """What frames and matches show before anything is mapped."""
    n = len(evidence.names)
    if n < LEAST_FRAMES:
        return failure("too_few_frames", f"there are {n} usable frames, and {LEAST_FRAMES} are the least")
    return _static(evidence) or _matching_failure(evidence) or _rotating(evidence)


def model_failure(
    evidence: CaptureEvidence, shape: ModelShape | None, focal_held: bool, stated_focal: float | None = None
) -> Failure | None:
    """What the model shows by itself.

    shape : None where the mapper made none; focal_held : the focal length was not refined; stated_focal : over the
    longer side, as EXIF or the user has it.
    """
    n = len(evidence.names)
    placed = 0 if shape is None else len(shape.names)
    if shape is None or placed < LEAST_FRAMES or placed <= PLACED_SHARE * n:
        return _placement_failure(evidence, placed)
    if shape.angle_deg < LEAST_ANGLE_DEG:
        seen = f"the views of a point differ by {shape.angle_deg:.1f} degrees at most"
        return failure("pure_rotation", seen)
    return _lens_failure(shape, focal_held, stated_focal)


def is_usable(shape: ModelShape | None, failure: Failure | None) -> bool:
    """Whether a model can be used: nothing refuses it, and frames taken three at a time do not contradict it."""
    return shape is not None and failure is None and contradiction(shape) is None


def can_answer(shape: ModelShape | None, failure: Failure | None) -> bool:
    """Whether a model of the global mapper can be used, which turns a pure rotation into a convincing model."""
    return shape is not None and failure is None and is_whole(shape) and shape.angle_deg >= RELIABLE_ANGLE_DEG


def is_whole(shape: ModelShape) -> bool:
    """Whether frames taken three at a time agree with a model and hold most of its frames together."""
    held = len(shape.agreement.pieces[0]) if shape.agreement.pieces else 0
    return contradiction(shape) is None and held > HELD_SHARE * shape.agreement.frames


def needs_check(evidence: CaptureEvidence, shape: ModelShape | None, failure: Failure | None) -> bool:
    """Whether the other mapper has to look at the matches: the model is refused, incomplete or may have drifted.

    Frames that are few steps of matches apart leave no room for a drift.
    """
    if failure is not None and failure.code not in OF_THE_LENS - {"focal_length_undetermined"}:
        return False
    if shape is None or not can_answer(shape, failure):
        return most_are_linked(evidence)
    return len(shape.names) < WHOLE_SHARE * len(evidence.names) or evidence.most_steps() > MOST_STEPS


def contradiction(shape: ModelShape | None) -> Failure | None:
    """The refusal of a model that frames taken three at a time contradict."""
    if shape is None:
        return None
    broken = shape.agreement.broken
    if len(broken) >= LEAST_BROKEN:
        seen = f"the camera's steps change their size at {broken[0]} and {len(broken) - 1} more frames"
        return failure("drift", seen)
    if shape.agreement.share <= MOST_CONTRADICTED:
        return None
    share = f"{100 * shape.agreement.share:.0f} %"
    seen = f"{share} of the frames, taken three at a time, contradict the camera's path, as where a pattern repeats"
    return failure("drift", seen)


def is_disputed(report: Mapping[str, Any]) -> bool:
    """Whether the global mapper answers, the incremental one has another path, and few points hold the first together.

    report : of a model, as `reconstruction.json` has it; one of an older version states no seam.
    """
    disagreement = report.get("disagreement")
    if report.get("mapper") != "global" or disagreement is None or report["model"] is None:
        return False
    return bool(disagreement > MOST_DISAGREEMENT and report["model"].get("seam", LEAST_SEAM) < LEAST_SEAM)


def drift(disagreement: float) -> Failure:
    """The refusal of two models that differ by this share of the path's extent."""
    seen = f"two ways of computing the camera's path differ by {100 * disagreement:.0f} % of its extent"
    return failure("drift", seen)


def lens_is_doubtful(shape: ModelShape | None, failure: Failure | None) -> bool:
    """Whether another camera model may explain the frames better: its residuals show a pattern, or it was refused."""
    if failure is not None and failure.code in OF_THE_LENS:
        return True
    return shape is not None and shape.pattern > PATTERN


def most_are_linked(evidence: CaptureEvidence) -> bool:
    """Whether the matches link so many frames that a model of them could be used."""
    return len(evidence.groups()[0]) > PLACED_SHARE * len(evidence.names)


def focal_is_determined(shape: ModelShape) -> bool:
    """Whether the frames, rather than what the mapper began with, decide the focal length."""
    return shape.focal_deviation is not None and shape.focal_deviation < UNDETERMINED


def focal_undetermined() -> Failure:
    """The refusal of a video that leaves the focal length open."""
    return failure(
        "focal_length_undetermined", "the camera moves almost without turning, and then any focal length fits"
    )


def _lens_failure(shape: ModelShape, focal_held: bool, stated: float | None) -> Failure | None:
    low, high = FOCAL_RANGE
    if stated is not None:
        low, high = min(low, stated / STATED_MARGIN), max(high, stated * STATED_MARGIN)
    if not focal_held and not focal_is_determined(shape):
        return focal_undetermined()
    if not focal_held and not low <= shape.focal <= high:
        range_words = f"not {low:.2g} to {high:.2g}"
        seen = f"the focal length came out as {shape.focal:.2f} times the picture's longer side, {range_words}"
        return failure("implausible_focal_length", seen)
    if shape.focal_spread is not None and shape.focal_spread > ZOOMED:
        seen = f"the frames disagree about the focal length, by {100 * shape.focal_spread:.1f} % from one to the next"
        return failure("focal_length_changes", seen)
    if shape.lens_bend > MOST_BEND and "FISHEYE" not in shape.camera:
        seen = f"the lens came out so bent that it moves the corners by {100 * shape.lens_bend:.0f} % of the picture"
        return failure("implausible_focal_length", seen)
    if not focal_held and shape.aspect > MOST_ASPECT:
        seen = f"the focal lengths across and down came out {100 * (shape.aspect - 1):.0f} % apart"
        return failure("implausible_focal_length", seen)
    return None


def _static(evidence: CaptureEvidence) -> Failure | None:
    """The picture moves nowhere: neither over the video nor between any two frames that match."""
    linked = [pair.moved_px for pair in evidence.linked_pairs]
    moved = max(linked, default=np.inf) / max(evidence.size)
    if moved < STATIC_SHARE and len(evidence.groups()[0]) > len(evidence.names) // 2:
        return failure("static_camera", f"the picture moves by {100 * moved:.1f} % of its width at most")
    return None


def _matching_failure(evidence: CaptureEvidence) -> Failure | None:
    """Hardly a frame matches another: nothing to see, or smeared."""
    largest = len(evidence.groups()[0])
    if largest >= max(LEAST_FRAMES, len(evidence.names) // 4):
        return _places(evidence)
    return _placement_failure(evidence, 0)


def _places(evidence: CaptureEvidence) -> Failure | None:
    groups = [len(group) for group in evidence.groups()]
    if groups[0] <= PLACED_SHARE * len(evidence.names) and len(groups) > 1 and groups[1] >= LEAST_FRAMES:
        seen = f"the frames fall into groups of {groups[0]} and {groups[1]} that show nothing in common"
        return failure("several_places", seen)
    return None


def _rotating(evidence: CaptureEvidence) -> Failure | None:
    share = evidence.rotation_share()
    if share > ROTATION_SHARE:
        seen = f"{100 * share:.0f} % of the frames differ by a turn of the camera alone"
        return failure("pure_rotation", seen)
    return None


def _placement_failure(evidence: CaptureEvidence, placed: int) -> Failure:
    """Why too few frames could be placed."""
    keypoints = float(np.median(evidence.keypoints)) if len(evidence.keypoints) else 0.0
    n = len(evidence.names)
    seen = f"{placed} of {n} frames could be placed"
    if _is_blurred(evidence):
        return failure("motion_blur", f"{seen}, and the sharpest frames are smeared")
    if keypoints < LEAST_KEYPOINTS:
        return failure("no_texture", f"{seen}, and a frame shows {keypoints:.0f} distinct points")
    return _places(evidence) or failure("too_few_frames", f"{seen}: most frames overlap too little with others")


def _is_blurred(evidence: CaptureEvidence) -> bool:
    low, high = evidence.edge_sharpness()
    return low is not None and high is not None and low < SMEARED[0] and high < SMEARED[1]
