"""Estimate the scale from the known distance between the cameras of a rig, such as a stereo pair."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.evidence.source import skipped_evidence
from estimator.records.objects import Measurements
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene
from metric_base.errors import FieldError, InputError, expect, in_file
from metric_base.input_files import read_json
from metric_base.length_units import metres
from metric_base.parsing import json_array, json_object, matrix_of
from metric_base.statistics import robust_sigma

#: Minimum standard deviation of the log scale: a baseline is accurate to about a millimetre, in the
#: reconstruction as well.
MIN_LOG_SD = 0.005
#: Minimum distance of two cameras, relative to the largest coordinate; smaller ones are rounding errors.
MIN_RELATIVE_DISTANCE = 1e-12


@dataclass(frozen=True, slots=True)
class RigBaseline:
    """The distance between two cameras of a rig.

    The cameras are given by the folders of their images in the model (`left/0001.png`, `right/0001.png`), or by
    prefixes that end in `_` or `-`. Simultaneous images have the same name after them.
    """

    first: str
    second: str
    metres: float

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """Return the scale by the median distance of the pairs, with the standard deviation of the median."""
        name = f"{self.first} to {self.second}"
        # Camera centres (3,) of the images in each folder, or with each prefix, by the remainder of their name.
        prefixes = [
            folder if folder.endswith(("/", "_", "-")) else f"{folder}/" for folder in (self.first, self.second)
        ]
        first, second = (
            {view.name.removeprefix(prefix): view.centre for view in scene.views if view.name.startswith(prefix)}
            for prefix in prefixes
        )
        distances = np.array([np.linalg.norm(first[key] - second[key]) for key in sorted(first.keys() & second.keys())])
        if not len(distances):
            return skipped_evidence("baseline", name, "the two cameras have no simultaneous images")
        median = float(np.median(distances))
        if not median > MIN_RELATIVE_DISTANCE * max(np.abs(view.centre).max() for view in scene.views):
            return skipped_evidence("baseline", name, "both cameras are at one place")
        median_sd = robust_sigma(distances) / median / math.sqrt(len(distances))
        return (ScaleEvidence("baseline", name, self.metres / median, math.hypot(median_sd, MIN_LOG_SD)),)


def parse_rig_baselines(text: str) -> tuple[RigBaseline, ...]:
    """Parse `A:B:METRES`, or read a rig file of COLMAP (`.json`). Raises InputError if the value is neither."""
    if text.endswith(".json"):
        return rig_baselines(Path(text))
    try:
        first, second, words = text.split(":")
        length = metres(words)
    except ValueError:
        length = 0.0
    if not 0 < length < math.inf:
        expected = "A:B:DISTANCE, two folders of images, as in left:right:12cm, or COLMAP's rig_config.json"
        raise InputError.at("--baseline", "value", expected, text)
    return (RigBaseline(first, second, length),)


def rig_baselines(file: Path) -> tuple[RigBaseline, ...]:
    """Read the baselines in metres from the reference to the other cameras in a rig configuration of COLMAP.

    The file is a list of rigs with `cameras`. Each camera has an `image_prefix` and, except for that with `ref_sensor`,
    a `cam_from_rig_translation`, whose length is the baseline.

    Raises
    ------
    InputError
        The file is damaged, or no camera has a translation.
    """
    with in_file(file):
        baselines = []
        for entry in json_array(read_json(file), "rigs"):
            cameras = [
                json_object(camera, "cameras") for camera in json_array(json_object(entry).get("cameras"), "cameras")
            ]
            prefixes = [camera.get("image_prefix") for camera in cameras]
            references = [prefix for prefix, camera in zip(prefixes, cameras, strict=True) if camera.get("ref_sensor")]
            if len(references) != 1 or not all(isinstance(prefix, str) and prefix for prefix in prefixes):
                raise FieldError("cameras", "an image_prefix each, and one ref_sensor", prefixes)
            for prefix, camera in zip(prefixes, cameras, strict=True):
                if not camera.get("ref_sensor") and "cam_from_rig_translation" in camera:
                    field, translation = "cam_from_rig_translation", camera["cam_from_rig_translation"]
                    length = math.hypot(*matrix_of(translation, (3,), field))
                    expect(0 < length < math.inf, field, "a translation that is not 0", translation)
                    baselines.append(RigBaseline(str(references[0]), str(prefix), length))
        expect(baselines, "cam_from_rig_translation", "three numbers at a camera of one rig or more", None)
    return tuple(baselines)
