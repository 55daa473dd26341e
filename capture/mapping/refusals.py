"""Refusals of captures: codes with advice, and the tests that refuse the frames or a model.

Each test compares a statistic of this capture with its standard error or with a limit that constructed errors exceed;
docs/explanation/capture.md lists the tests, the errors that they guard against, and their rates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.mapping.match_graph import MatchGraph
from capture.mapping.model_metrics import ModelMetrics
from capture.mapping.triplets import MAX_PART_RATIO

#: Focal length over the longer side before anything is known: a telephone's main camera while recording. Its 24 to 28
#: mm (of 35 mm film) are 0.69 to 0.81 of the longer side of a photograph, and a video is cropped by a tenth or so.
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
#: Minimum number of frames: five frames of a room gave two placed images, or a focal length with an error of 10 %.
MIN_FRAMES = 6
#: Maximum motion of a static camera, relative to the longer side. On a tripod it is 0.000; thirty steps ahead through
#: a wide lens (`walk_carpark`) have 0.015, far and near features together.
MAX_STATIC_MOTION = 0.005
#: Minimum number of features per frame; an ordinary image has a thousand.
MIN_KEYPOINTS = 150
#: Minimum steepness of edges in the least and the steepest direction. Sharp rooms have 0.19 and 0.22, a motion blur of
#: a fortieth of the width 0.10 and 0.17, a plain room 0.02 and 0.35.
MIN_EDGE_STEEPNESS = (0.12, 0.19)
#: Minimum ratio of the moving pairs that a rotation explains: a turn on the spot 0.99, a walk through a room 0.05.
MIN_ROTATION_RATIO = 0.6
#: Minimum ratio of the frames that a usable model contains, exclusive.
MIN_PLACED_RATIO = 0.5
#: Minimum ratio of placed frames of a model that needs no other lens and no other strategy.
MIN_WHOLE_RATIO = 0.8
#: Maximum `focal_deviation`. Synthetic videos: walks round objects 0.008, straight ahead with a hand that sways by 2
#: degrees 0.02, by 0.3 degrees 0.07, by none 0.5 and more. The errors are as large: 0.003, 0.01, 0.07, 0.4 to 0.8.
MAX_FOCAL_STD = 0.1
#: Minimum `focal_change` of a zoom, absolute and in multiples of its standard error. Aerial images from above have
#: frames that differ by 1 to 2 % at random; a zoom of 30 % during a walk is found as 31 % with an error of 0.2 %, and
#: the shared focal length is wrong by 13 to 23 %.
MIN_ZOOM, MIN_ZOOM_ERRORS = 0.1, 4.0
#: `focal_spread` with a warning: with all furniture moving by 3 cm a frame it is 0.0039, and the error 12 %. Of 68
#: right models of real sets and their parts 6 have more.
MIN_WARNED_FOCAL_VARIATION = 0.0035
#: `focal_deviation` with a warning, and the ratio of the error to it: the models above have errors of 7 % (root mean
#: square; at most 15 %) at 3.4 % on average.
MIN_WARNED_FOCAL_STD, FOCAL_ERROR_RATIO = 0.02, 2.0
#: Maximum displacement of the corners by the distortion, relative to the longer side, of a lens that is no fisheye.
MAX_BEND = 0.2
#: Maximum ratio of the focal lengths across and down; pixels are square, and right models differ by up to 3 %.
MAX_ASPECT = 1.05
#: Maximum change of the focal length from the camera model of the user to one that fits significantly better. Two wrong
#: lenses (`SIMPLE_PINHOLE` with distortion, a fisheye as `SIMPLE_RADIAL`) have 11 to 18 %, and the other model the
#: true focal length within 0.3 %.
MAX_MODEL_FOCAL_CHANGE = 0.05
#: Minimum `residual_pattern` at which camera models are compared: a wide lens under SIMPLE_RADIAL has 0.16, phones
#: 0.02.
MIN_COMPARED_PATTERN = 0.06
#: `residual_pattern` with a warning; the right camera model has up to 0.09 in short rendered videos.
MIN_WARNED_PATTERN = 0.12
#: Maximum ratio of triplets that a model contradicts, and minimum number of broken frames of a wrong model. On the
#: matches of `lund_street` right models have none above 2 px, wrong ones 33 to 74 %. A walk of which 25 frames were
#: four times too large (`walk_carpark`) had six broken frames, 55 right models none.
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
