"""Refusals of captures: codes with advice, and the tests that refuse the frames or a model.

Each test compares a statistic of the capture with its standard error, or with a limit that only captures with a
constructed error exceed. docs/explanation/capture.md lists the tests, the errors that they detect, and their rates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.mapping.match_graph import MatchGraph
from capture.mapping.model_metrics import ModelMetrics
from capture.mapping.triplets import MAX_PART_RATIO

#: Assumed focal length of an unknown camera, relative to the longer side of the image: that of the main camera of a
#: telephone in a video. Its 24 to 28 mm (in terms of 35 mm film) are 0.69 to 0.81 of the longer side of a photograph,
#: and a video is cropped by about a tenth.
TYPICAL_FOCAL = 0.85
#: Advice by code; the message of a failure begins with the observation.
ADVICE = {
    "pure_rotation": "walk sideways or around the objects while recording; turning on the spot shows no depth",
    "static_camera": "move the camera: walk around the objects, at least a step to each side",
    "no_texture": "record objects with visible detail, in good light; plain walls and floors cannot be matched",
    "too_few_frames": "record ten seconds or more, or take twenty images, each overlapping the next by two thirds",
    "motion_blur": "move more slowly, hold the camera steadily, and use more light",
    "several_places": "record one place in one go, without cuts, and come back over what was seen before",
    "drift": "record a loop that comes back to its start, sideways rather than straight ahead, and more slowly",
    "implausible_focal_length": "give the focal length with --focal, do not zoom, and walk around the objects",
    "wrong_camera_model": "omit --camera-model, so that it is chosen by the images",
    "focal_length_changes": "do not zoom or let the telephone change lenses, and do not record moving objects",
    "focal_length_undetermined": "walk around the objects or turn the camera as you walk, or give the focal length in "
    f"pixels with --focal (a telephone's main camera: about {TYPICAL_FOCAL} times the longer side of the image)",
    "out_of_time": "give more time with --max-time, or use fewer frames with --frames",
}
CODES = tuple(ADVICE)
#: Minimum number of frames. From five frames of a room, the mapper placed only two images, or found a focal length with
#: an error of 10 %.
MIN_FRAMES = 6
#: Maximum motion of the image of a static camera, relative to the longer side. It is 0.000 on a tripod, and 0.015 for
#: thirty steps ahead with a wide lens (`walk_carpark`), over near and distant features.
MAX_STATIC_MOTION = 0.005
#: Minimum number of features per frame; an ordinary image has a thousand.
MIN_KEYPOINTS = 150
#: Minimum steepness of edges in the direction in which they are least steep, and in the direction in which they are
#: steepest. Frames of a sharp room have 0.19 and 0.22, with a motion blur of a fortieth of the width 0.10 and 0.17, and
#: frames of a plain room 0.02 and 0.35. Frames are blurred if both values are below their minimum.
MIN_EDGE_STEEPNESS = (0.12, 0.19)
#: Minimum fraction of the moving pairs of frames that a rotation of the camera explains, for a refusal. It is 0.99 for
#: a turn on the spot and 0.05 for a walk through a room.
MIN_ROTATION_RATIO = 0.6
#: Fraction of the frames of which a usable model contains more.
MIN_PLACED_RATIO = 0.5
#: Minimum fraction of placed frames of a model for which no other lens and no other strategy are tried.
MIN_WHOLE_RATIO = 0.8
#: Maximum `ModelMetrics.focal_deviation`. In synthetic videos it is 0.008 for walks round objects; for walks straight
#: ahead it is 0.02 with a camera that sways by 2 degrees, 0.07 with 0.3 degrees, and 0.5 or more without. The errors of
#: the focal length in the same order are 0.003, 0.01, 0.07, and 0.4 to 0.8.
MAX_FOCAL_STD = 0.1
#: Minimum `ModelMetrics.focal_change` of a zoom, absolute and in multiples of its standard error. The focal lengths of
#: aerial images differ by 1 to 2 % at random. A zoom of 30 % during a walk is estimated as 31 % with a standard error
#: of 0.2 %, and the shared focal length is wrong by 13 to 23 %.
MIN_ZOOM, MIN_ZOOM_ERRORS = 0.1, 4.0
#: Value of `ModelMetrics.focal_spread` above which there is a warning. If all furniture moves by 3 cm between frames,
#: it is 0.0039 and the focal length is wrong by 12 %. Of 68 right models of real sets and their parts, 6 exceed it.
MIN_WARNED_FOCAL_VARIATION = 0.0035
#: Value of `focal_deviation` above which there is a warning, and ratio of the actual error to it. Models above this
#: value have errors of 7 % (root mean square; at most 15 %) with a `focal_deviation` of 3.4 % on average.
MIN_WARNED_FOCAL_STD, FOCAL_ERROR_RATIO = 0.02, 2.0
#: Maximum displacement of the corners by the distortion, relative to the longer side, of a lens that is no fisheye.
MAX_BEND = 0.2
#: Maximum ratio of the focal lengths across and down; pixels are square, and right models differ by up to 3 %.
MAX_ASPECT = 1.05
#: Maximum relative change of the focal length from the camera model that the user gave to one that fits significantly
#: better. For two wrong models (`SIMPLE_PINHOLE` for a lens with distortion, `SIMPLE_RADIAL` for a fisheye) it is 11 to
#: 18 %, and the better model has the true focal length within 0.3 %.
MAX_MODEL_FOCAL_CHANGE = 0.05
#: Minimum `residual_pattern` at which camera models are compared. A wide lens modelled as SIMPLE_RADIAL has 0.16,
#: phones 0.02.
MIN_COMPARED_PATTERN = 0.06
#: Value of `residual_pattern` above which there is a warning; the right camera model has up to 0.09 in short rendered
#: videos.
MIN_WARNED_PATTERN = 0.12
#: Maximum fraction of triplets of frames that contradict a model, and minimum number of broken frames of a wrong model.
#: With the matches of `lund_street`, right models have no contradicting triplets (above 2 px), and wrong ones 33 to 74
#: %. A model of `walk_carpark` in which 25 frames were four times too large had six broken frames, and 55 right models
#: had none.
MAX_CONTRADICTED_RATIO, MIN_BROKEN_FRAMES = 0.05, 2
#: Maximum standard deviation of the steps to a placed frame, relative to their length. At the end of `snow_walk` five
#: frames see only distant points in common: their steps have 0.11 to 0.18 and are wrong by a factor of two, whereas no
#: frame of 13 other models has more than 0.06.
MAX_STEP_STD = 0.1
#: Failures that become warnings if the global mapper finds the same path and all frames are placed. It does not
#: test an undetermined or a changing focal length: both mappers agree on the same wrong one.
DISPUTABLE = frozenset({"drift", "implausible_focal_length"})
#: Maximum distance of the paths of two mappers that agree, relative to the extent.
MAX_DISAGREEMENT = 0.01


@dataclass(frozen=True, slots=True)
class Failure:
    """A code of docs/how-to/scale-from-a-video.md, and one line for a person."""

    code: str
    message: str


class CaptureFailure(Exception):
    """A capture that cannot be used."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.message)
        self.failure = failure


def refusal(code: str, observation: str) -> Failure:
    """Return a failure whose message has the observation and the advice of the code."""
    return Failure(code, f"{observation}; {ADVICE[code]}")


def early_failure(graph: MatchGraph) -> Failure | None:
    """Return the failure that the frames and their matches show before the mapping."""
    n = len(graph.names)
    if n < MIN_FRAMES:
        return refusal("too_few_frames", f"there are {n} usable frames, and {MIN_FRAMES} are the minimum")
    n_linked = len(graph.groups()[0])
    moved = max((pair.moved_px for pair in graph.tested_pairs), default=np.inf) / max(graph.size)
    if moved < MAX_STATIC_MOTION and n_linked > n // 2:
        return refusal("static_camera", f"the image moves by at most {100 * moved:.1f} % of its width")
    if n_linked < MIN_FRAMES:
        return placement_failure(graph, 0)
    ratio = graph.rotation_ratio()
    if ratio > MIN_ROTATION_RATIO:
        observation = f"{100 * ratio:.0f} % of the pairs of moving frames differ by a rotation of the camera alone"
        return refusal("pure_rotation", observation)
    return None


def placement_failure(graph: MatchGraph, n_placed: int) -> Failure:
    """Return the reason why too few frames were placed."""
    n = len(graph.names)
    observation = f"{n_placed} of {n} frames could be placed"
    low, high = graph.edge_sharpness()
    if low is not None and high is not None and low < MIN_EDGE_STEEPNESS[0] and high < MIN_EDGE_STEEPNESS[1]:
        return refusal("motion_blur", f"{observation}, and the sharpest frames are blurred")
    keypoints = float(np.median(graph.keypoints)) if len(graph.keypoints) else 0.0
    if keypoints < MIN_KEYPOINTS:
        return refusal("no_texture", f"{observation}, and a frame has {keypoints:.0f} distinct points")
    groups = [len(group) for group in graph.groups()]
    if groups[0] <= MIN_PLACED_RATIO * n and len(groups) > 1 and groups[1] >= MIN_FRAMES:
        seen = f"the frames fall into groups of {groups[0]} and {groups[1]} that have nothing in common"
        return refusal("several_places", seen)
    return refusal("too_few_frames", f"{observation}: most frames overlap too little with others")


def model_failure(graph: MatchGraph, model: ModelMetrics | None, focal_held: bool) -> Failure | None:
    """Return the failure that a model shows.

    Parameters
    ----------
    graph : MatchGraph
        All frames and their matches.
    model : ModelMetrics or None
        None if the mapper found no model.
    focal_held : bool
        Whether the focal length was not refined.
    """
    n_placed = 0 if model is None else model.registered
    if model is None or n_placed < MIN_FRAMES or n_placed <= MIN_PLACED_RATIO * len(graph.names):
        return placement_failure(graph, n_placed)
    if len(model.pieces) > 1 and model.pieces[1] > MAX_PART_RATIO * model.pieces[0]:
        seen = f"the matches of three frames hold together only parts of {model.pieces[0]} and {model.pieces[1]} frames"
        return refusal("several_places", seen)
    failure = lens_failure(model, focal_held)
    if failure is not None:
        return failure
    change = abs(model.focal_change)
    if change > max(MIN_ZOOM, MIN_ZOOM_ERRORS * model.focal_change_error):
        seen = f"the focal length changes by {100 * change:.0f} % from the first to the last frame"
        return refusal("focal_length_changes", seen)
    return contradiction(model)


def lens_failure(model: ModelMetrics, focal_held: bool) -> Failure | None:
    """Return the failure that the camera of a model shows; parameters as for `model_failure`."""
    if not focal_held and (model.focal_deviation is None or model.focal_deviation > MAX_FOCAL_STD):
        seen = "the camera moves almost without turning, and then any focal length fits"
        return refusal("focal_length_undetermined", seen)
    seen = ""
    if not focal_held and model.aspect > MAX_ASPECT:
        seen = f"the focal lengths across and down differ by {100 * (model.aspect - 1):.0f} %"
    elif model.lens_bend > MAX_BEND and "FISHEYE" not in model.camera:
        seen = f"the distortion moves the corners by {100 * model.lens_bend:.0f} % of the image"
    return refusal("implausible_focal_length", seen) if seen else None


def contradiction(model: ModelMetrics) -> Failure | None:
    """Return the failure of a model that the matches of three frames contradict."""
    if len(model.broken) >= MIN_BROKEN_FRAMES:
        seen = f"the length of the camera's steps changes at {model.broken[0]} and {len(model.broken) - 1} more frames"
        return refusal("drift", seen)
    ratio = model.contradicted / max(model.triplets, 1)
    if ratio <= MAX_CONTRADICTED_RATIO:
        return None
    seen = f"{100 * ratio:.0f} % of the frames, taken three at a time, contradict the camera path"
    return refusal("drift", f"{seen}, as if a pattern repeats")
