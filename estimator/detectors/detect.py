"""A detector's instances in the pictures of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from estimator.detectors.detector import MIN_SCORE, Detections, Detector, Picture
from estimator.instances.view_matching import image_file, mask_crop
from estimator.records.scene import Instance, Scene, View
from metric_base.errors import InputError, Unquoted, in_file
from metric_base.images import read_picture
from metric_base.progress import ProgressCallback, silent, with_progress


def detect_instances(
    scene: Scene, images: Path, detector: Detector, progress: ProgressCallback = silent
) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances that a detector sees in the scene's pictures, and warnings.

    images : the folder that holds them, by the views' names, else by their base names.

    Raises
    ------
    InputError
        The folder is not there, holds none of the views' pictures, or nothing is detected in any.
    """
    if not images.is_dir():
        raise InputError.at(images, "--images", "a folder with the scene's pictures", Unquoted("no such folder"))
    files = [(row, view, _picture_file(images, view)) for row, view in enumerate(scene.views)]
    there = [(row, view, file) for row, view, file in files if file is not None]
    if not there:
        expected = f"pictures by the names of the model's views, such as {scene.views[0].name!r}"
        raise InputError.at(images, "--images", expected, Unquoted("none of them"))
    instances: list[Instance] = []
    for row, view, file in with_progress(there, "detecting", progress):
        instances += _instances(row, view, detector(_picture(file)), detector)
    if not instances:
        expected = f"a detection of score {MIN_SCORE} or more in one of {len(there)} pictures"
        raise InputError.at(detector.path, "detections", expected, Unquoted("none"))
    lost = len(files) - len(there)
    return tuple(instances), ((f"{images}: {lost} of {len(files)} views have no picture",) if lost else ())


def _instances(row: int, view: View, seen: Detections, detector: Detector) -> Iterator[Instance]:
    for number, (label, score, mask) in enumerate(zip(seen.labels, seen.scores, seen.masks, strict=True)):
        name = detector.labels[label] if 0 <= label < len(detector.labels) else ""
        if not name:
            expected = f"a number with a name (1 to {len(detector.labels) - 1}; name them with --detector-labels)"
            raise InputError.at(detector.path, "label", expected, int(label))
        with in_file(Path(view.name)):
            crop = mask_crop(mask, view.camera)
        if crop is not None:
            yield Instance(
                f"{row}-{number}", row, name, crop[0], crop[1], score=float(min(score, 1.0)), from_box=seen.from_boxes
            )


def _picture_file(images: Path, view: View) -> Path | None:
    folder = images.resolve()
    by_name = image_file((folder,), view)
    base = folder / Path(view.name.replace("\\", "/")).name
    return by_name or (base if base.is_file() else None)


def _picture(file: Path) -> Picture:
    """(H, W, 3) RGB; turned as its camera saw it, which is how the model's keypoints count."""
    import cv2

    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    picture = read_picture(file, flags)
    if picture is None:
        raise InputError.at(file, "picture", "a picture that OpenCV reads", Unquoted("something else"))
    return np.ascontiguousarray(picture[:, :, ::-1])
