"""What the user of a capture's scale should know: kept in the work folder, stated with every result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from capture.mapping.refusals import (
    DOUBTFUL_PATTERN,
    FOCAL_ERROR_TIMES,
    SMEARED,
    UNDETERMINED,
    UNSTEADY,
    UNSURE,
    is_disputed,
)
from capture.sources.frames import Frames
from metric_base.errors import InputError, in_file
from metric_base.files import whole_file
from metric_base.input_files import read_json
from metric_base.parsing import json_array

CAUTIONS_FILE = "cautions.json"
SCHEMA = "metric-tree/cautions/1"
#: Frames without a place that are named.
MOST_NAMED = 5


def capture_cautions(path: Path, frames: Frames, report: dict[str, Any], focal_given: bool) -> tuple[str, ...]:
    """Sentences about a reconstruction that can be used.

    path : the video or the folder of pictures; report : `reconstruction.json`; focal_given : by `--focal`.
    """
    cautions = [f"{path}: {remark}" for remark in frames.remarks]
    if frames.hdr is not None:
        cautions.append(
            f"{path}: an HDR video ({frames.hdr}); its frames are tone-mapped to an ordinary screen's range"
        )
    if not frames.one_camera:
        words = "; --focal is not used" if focal_given else ""
        cautions.append(
            f"{path}: pictures of {len(frames.cameras())} cameras, by their sizes and EXIF's focal lengths{words}"
        )
    if report["model"]["left_out"]:
        cautions.append(f"{path}: {_left_out(report['model']['left_out'], report['pairs']['frames'])}")
    if frames.one_camera and _lens_is_doubtful(report):
        cautions.append(
            f"{path}: the camera model ({report['model']['camera']}) leaves a pattern in the residuals, so its focal "
            "length may be wrong by a tenth or two; name the lens with --camera-model and --focal if you know it"
        )
    focal = _of_the_focal_length(report, "--focal" if focal_given else "the file")
    return (*cautions, *(f"{path}: {words}" for words in (*focal, *_of_the_motion(report))))


def _lens_is_doubtful(report: dict[str, Any]) -> bool:
    """Whether the residuals show a pattern and no comparison on held out observations found that camera model best."""
    model, choice = report["model"], report.get("lenses")
    compared = choice is not None and choice["chosen"] == model["camera"]
    return bool(model["pattern"] > DOUBTFUL_PATTERN) and not compared


def _left_out(names: list[str], n_frames: int) -> str:
    named = ", ".join([*names[:MOST_NAMED], *(["..."] if len(names) > MOST_NAMED else [])])
    return f"{len(names)} of {n_frames} frames could not be placed and are not used: {named}"


def write_cautions(cautions: tuple[str, ...], folder: Path) -> None:
    """Keep them in a work folder."""
    with whole_file(folder / CAUTIONS_FILE, "--work", "metric-tree/cautions/") as file:
        file.write_text(json.dumps({"schema": SCHEMA, "cautions": list(cautions)}) + "\n", encoding="utf-8")


def read_cautions(folder: Path) -> tuple[str, ...]:
    """Those of a work folder, none where there are none.

    Raises
    ------
    InputError
        The file is damaged.
    """
    file = folder / CAUTIONS_FILE
    if not file.is_file():
        return ()
    with in_file(file):
        record = read_json(file)
        rows = json_array(record.get("cautions") if isinstance(record, dict) else record)  # 1.0.0 wrote the list alone
    if not all(isinstance(row, str) for row in rows):
        raise InputError.at(file, "cautions", "sentences", rows)
    return tuple(rows)


def _of_the_focal_length(report: dict[str, Any], stated_by: str) -> list[str]:
    deviation, focal = report["model"]["focal_deviation"], report["model"]["focal"]
    determined = deviation is not None and deviation < UNDETERMINED
    if report["focal_held"] and not determined:
        return [
            f"the frames do not determine the focal length, and that of {stated_by} is held ({focal:.2f} times the "
            "longer side): if it is wrong by 10 %, everything is 10 % too deep or too shallow for its width"
        ]
    if not report["focal_held"] and deviation > UNSURE:
        share = FOCAL_ERROR_TIMES * deviation
        return [
            f"the frames determine the focal length only to about {100 * share:.0f} %, and so depths against "
            "widths; walk around the objects, turn the camera as you walk, or give --focal"
        ]
    return []


def _of_the_motion(report: dict[str, Any]) -> list[str]:
    """What a smear, or objects that move, leave in a model that can be used."""
    if is_disputed(report):
        return [
            f"two ways of computing the camera's path differ by {100 * report['disagreement']:.0f} % of its extent; "
            "that which the matches of three frames agree with is used; more frames would settle it"
        ]
    low, high = report["pairs"]["edges"]
    if low is not None and low < SMEARED[0] and high < SMEARED[1]:
        return ["the frames are smeared, and lengths may be wrong by some per cent; move more slowly, in more light"]
    spread = report["model"]["focal_spread"]
    if spread is not None and spread > UNSTEADY:
        return [
            f"the frames disagree about the focal length, by {100 * spread:.1f} % from one to the next: a zoom, or "
            "much of the picture moves; lengths may be wrong by a tenth"
        ]
    return []
