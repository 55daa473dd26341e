"""Warnings about a reconstruction, which `caution_files` stores in the work folder."""

from __future__ import annotations

from pathlib import Path

from capture.mapping.mapper import ModelReport
from capture.mapping.model_metrics import ModelMetrics
from capture.mapping.refusals import (
    FOCAL_ERROR_RATIO,
    MAX_FOCAL_STD,
    MIN_EDGE_STEEPNESS,
    MIN_WARNED_FOCAL_STD,
    MIN_WARNED_FOCAL_VARIATION,
    MIN_WARNED_PATTERN,
)
from capture.sources.frames import Frames

#: Maximum number of frames without a place that are named.
MAX_NAMED = 5


def capture_cautions(path: Path, frames: Frames, report: ModelReport, focal_given: bool) -> tuple[str, ...]:
    """Return the warnings about a reconstruction that can be used.

    Parameters
    ----------
    path : Path
        The video or the folder of images.
    frames : Frames
    report : ModelReport
        Report of its model.
    focal_given : bool
        Whether `--focal` was given.
    """
    model = report.model
    assert model is not None
    warnings = list(frames.remarks)
    if frames.hdr is not None:
        warnings.append(f"an HDR video ({frames.hdr}); its frames are tone-mapped to an ordinary screen's range")
    if not frames.one_camera:
        unused = "; --focal is not used" if focal_given else ""
        warnings.append(f"images of {len(frames.cameras())} cameras, by their sizes and EXIF's focal lengths{unused}")
    if report.left_out:
        named = ", ".join([*report.left_out[:MAX_NAMED], *(["..."] if len(report.left_out) > MAX_NAMED else [])])
        n = len(frames.names)
        warnings.append(f"{len(report.left_out)} of {n} frames could not be placed and are not used: {named}")
    if model.undetermined:
        count = len(model.undetermined)
        warnings.append(
            f"{count} of these frames share only distant points with the others, and their place is unknown"
        )
    compared = report.lenses is not None and report.lenses.chosen == model.camera
    if frames.one_camera and model.pattern > MIN_WARNED_PATTERN and not compared:
        warnings.append(
            f"the camera model ({model.camera}) leaves a pattern in the residuals, so its focal length may be wrong by "
            "10 to 20 %; name the lens with --camera-model and --focal if you know it"
        )
    warnings += _focal_warnings(report, model, focal_given)
    low, high = report.pairs["edges"]
    spread = model.focal_spread
    if report.overruled is not None:
        warnings.append(f"{report.overruled.message}; another mapper finds the same path")
    elif low is not None and low < MIN_EDGE_STEEPNESS[0] and high < MIN_EDGE_STEEPNESS[1]:
        warnings.append("the frames are blurred, and lengths may be wrong by several percent; move more slowly")
    elif spread is not None and spread > MIN_WARNED_FOCAL_VARIATION:
        warnings.append(
            f"the frames disagree about the focal length, by {100 * spread:.1f} % from one to the next: a zoom, or "
            "objects that move; lengths may be wrong by 10 %"
        )
    return tuple(f"{path}: {warning}" for warning in warnings)


def _focal_warnings(report: ModelReport, model: ModelMetrics, focal_given: bool) -> list[str]:
    """Return the warning that the frames hardly determine the focal length, if so."""
    deviation = model.focal_deviation
    if report.focal_held and (deviation is None or deviation > MAX_FOCAL_STD):
        source = "--focal" if focal_given else "the file"
        return [
            f"the frames do not determine the focal length, and that of {source} is held ({model.focal:.2f} times the "
            "longer side): if it is wrong by 10 %, everything is 10 % too deep or too shallow for its width"
        ]
    if not report.focal_held and deviation is not None and deviation > MIN_WARNED_FOCAL_STD:
        return [
            f"the frames determine the focal length only to about {100 * FOCAL_ERROR_RATIO * deviation:.0f} %, and so "
            "depths against widths; walk around the objects, turn the camera as you walk, or give --focal"
        ]
    return []
