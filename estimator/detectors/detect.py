"""Detect instances in the images of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2

from estimator.detectors.detector import MIN_SCORE, Detections, Detector
from estimator.instances.view_matching import Instances, instance_of_mask
from estimator.reconstructions.image_files import image_file, image_folders
from estimator.records.scene import Instance, Scene
from metric_base.errors import InputError, Unquoted, in_file
from metric_base.images import checked_image
from metric_base.progress import ProgressCallback, silent, with_progress


def detect_instances(
    scene: Scene, images: Path | None, detector: Detector, progress: ProgressCallback = silent
) -> Instances:
    """Detect instances in the images of a scene.

    Parameters
    ----------
    scene : Scene
    images : Path or None
        Folder of the images, with the names of the views or their base names; by default the folders of
        `image_folders`.
    detector : Detector
    progress : callable, optional

    Returns
    -------
    instances : tuple of Instance
    warnings : tuple of str

    Raises
    ------
    InputError
        The folder is missing or contains no image of the views, nothing is detected in any image, or a label has no
        name.
    """
    if images is not None and not images.is_dir():
        raise InputError.at(images, "--images", "a folder with the images of the scene", Unquoted("no such folder"))
    folders = image_folders(scene) if images is None else (images.resolve(),)
    files: list[tuple[int, Path]] = []
    for index, view in enumerate(scene.views):
        by_base_name = [folder / Path(view.name.replace("\\", "/")).name for folder in folders]
        file = image_file(folders, view) or next((file for file in by_base_name if file.is_file()), None)
        if file is not None:
            files.append((index, file))
    if not files:
        expected = f"a folder of images with the names of the views, such as {scene.views[0].name!r}"
        raise InputError.at(images or scene.path, "--images", expected, Unquoted("none of them"))
    instances: list[Instance] = []
    for index, file in with_progress(files, "detecting", progress):
        # The orientation of the file is ignored, because keypoints refer to the image as the camera stored it.
        image = checked_image(file, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        detections = detector(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
        instances += _instances(index, scene, detections, detector)
    if not instances:
        expected = f"a detection of score {MIN_SCORE} or more in one of {len(files)} images"
        raise InputError.at(detector.path, "detections", expected, Unquoted("none"))
    missing = len(scene.views) - len(files)
    warning = f"{images or scene.path}: {missing} of {len(scene.views)} views have no image"
    return tuple(instances), (warning,) if missing else ()


def _instances(index: int, scene: Scene, detections: Detections, detector: Detector) -> Iterator[Instance]:
    """Yield the detections in an image as instances of the view with this index; empty masks are dropped."""
    for number, (label, mask) in enumerate(zip(detections.labels, detections.masks, strict=True)):
        name = detector.labels[label] if 0 <= label < len(detector.labels) else ""
        if not name:
            expected = f"a number with a name (1 to {len(detector.labels) - 1}; name them with --detector-labels)"
            raise InputError.at(detector.path, "label", expected, int(label))
        score, identity = float(min(detections.scores[number], 1.0)), f"{index}-{number}"
        with in_file(Path(scene.views[index].name)):
            item = instance_of_mask(scene, index, identity, name, mask, score, from_box=detections.from_boxes)
        if item is not None:
            yield item
