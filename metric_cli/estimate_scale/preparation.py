"""What `estimate-scale` does with a video or pictures before it has a scene: reconstruct, find instances."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from estimator.capture.frames import FRAMES_FILE, is_capture
from metric_base.errors import InputError, Unquoted

if TYPE_CHECKING:
    from estimator.capture.mapping.failures import Failure
    from estimator.capture.work_folder import WorkFolder

__all__ = ["INSTANCES", "RESULT", "failure_json", "prepare_capture"]

INSTANCES, RESULT = "instances.json", "result.json"
#: What was drawn so far, kept over an interruption.
DRAFT = "drawing.json"
#: Options that mean something only for a video or pictures.
_CAPTURE_OPTIONS = ("--work", "--frames", "--focal", "--camera-model", "--draw")


def prepare_capture(options: Namespace) -> Failure | None:
    """Turn a video or a folder of pictures into a scene: `options` then names the work folder as SCENE.

    Options of a reconstruction are left as they are. A capture that cannot be used gives its failure; the command
    ends with status 3.

    Raises
    ------
    InputError
        A video that cannot be read, an option that does not fit, or no instances.
    """
    if options.scene is None or not is_capture(options.scene):
        options.dense = _dense_of(options)
        for name in _CAPTURE_OPTIONS:
            if getattr(options, name.strip("-").replace("-", "_")) is not None:
                words = Unquoted(str(options.scene or options.objects))
                raise InputError.at("arguments", name, "a video or a folder of pictures as SCENE", words)
        return None
    if options.draw is not None and not 0 <= options.draw < 1 << 16:
        raise InputError.at("--draw", "port", "a number from 0 to 65535", options.draw)
    if options.work is None:
        raise InputError.at(options.scene, "--work", "a folder for frames, reconstruction and result", Unquoted("none"))
    for file in (options.instances, options.categories, options.detector_labels):
        if file is not None and not file.exists():  # said now rather than after the reconstruction
            raise InputError.at(file, "file", "a readable file", Unquoted("no such file"))
    return _prepare(options)


def failure_json(failure: Failure) -> str:
    """The result of a capture that cannot be used."""
    record = {"schema": "metric-tree/scale/1", "status": "unresolved", "failure": failure.json()}
    return json.dumps(record, indent=1, ensure_ascii=False)


def _prepare(options: Namespace) -> Failure | None:
    from estimator.capture.capture import CaptureOptions, reconstruct
    from estimator.capture.mapping.failures import CaptureFailure
    from estimator.capture.work_folder import WorkFolder

    dense = options.dense == "auto"
    capture = CaptureOptions(options.frames, options.focal, options.camera_model or "SIMPLE_RADIAL", dense)
    work = WorkFolder(options.work)
    with work.lock():
        try:
            reconstruct(options.scene, work, capture)
        except CaptureFailure as refusal:
            return refusal.failure
        _prepare_instances(options, work)
    options.scene = work.path
    options.dense = _dense_of(options)
    return None


def _dense_of(options: Namespace) -> str | None:
    """The cloud to measure from: in a work folder none but one that is named.

    The dense points of a work folder are for what is drawn. They have been better and worse than the sparse ones
    (docs/evidence/videos.md), on too few scenes to be the default.
    """
    if options.dense not in (None, "auto"):
        return str(options.dense)
    is_work_folder = options.scene is not None and (options.scene / FRAMES_FILE).is_file()
    return "none" if is_work_folder else None


def _prepare_instances(options: Namespace, work: WorkFolder) -> None:
    """`instances.json` in the work folder: given, detected, drawn on a page, or made before."""
    beside = options.scene / INSTANCES
    if options.detector is not None:
        _detect(options, work)
        options.detector = options.images = None
    elif options.instances is not None or (options.scene.is_dir() and beside.is_file()):
        file = options.instances or beside
        if file.is_file() and options.categories is None:
            _copy_dataset(file, work)
            options.instances = None if (work.path / INSTANCES).is_file() else file
    elif options.draw is not None or not (work.path / INSTANCES).is_file():
        _draw(options, work)


def _copy_dataset(file: Path, work: WorkFolder) -> None:
    """The part of a dataset that is about the chosen frames: one of a video may name every frame of it."""
    from estimator.capture.frames import read_frames
    from estimator.capture.work_folder import content_digest
    from metric_base.input_files import read_json

    document = read_json(file)
    if not isinstance(document, dict):  # bare results need their categories: they are read where they are
        (work.path / INSTANCES).unlink(missing_ok=True)
        return
    if file.resolve() == (work.path / INSTANCES).resolve():
        return
    names = read_frames(work.path).names

    def make(part: Path) -> None:
        kept = json.dumps(_of_frames(document, set(names)))
        (part / INSTANCES).write_text(kept + "\n", encoding="utf-8")

    work.stage("instances", {"file": content_digest(file), "frames": names}, [INSTANCES], make)


def _of_frames(document: dict[str, Any], names: set[str]) -> dict[str, Any]:
    """The dataset without images of other frames; as it is where that would leave nothing, or it is no dataset."""
    images, annotations = document.get("images"), document.get("annotations")
    if not isinstance(images, list) or not isinstance(annotations, list):
        return document
    if not all(isinstance(row, dict) for row in (*images, *annotations)):
        return document
    kept = [image for image in images if str(image.get("file_name", "")).replace("\\", "/").split("/")[-1] in names]
    ids = [image.get("id") for image in kept]
    if not kept or not all(isinstance(number, int | str) for number in ids):
        return document
    others = [image.get("id") for image in images if image not in kept]
    about = [annotation for annotation in annotations if annotation.get("image_id") not in others]
    return document | {"images": kept, "annotations": about}


def _detect(options: Namespace, work: WorkFolder) -> None:
    from estimator.capture.instances_file import write_instances
    from estimator.capture.work_folder import content_digest
    from estimator.instances.detection import detect_instances
    from estimator.instances.detector import MAX_LABEL_BYTES, load_detector
    from estimator.reconstructions.colmap import read_colmap
    from metric_base.input_files import read_text

    def make(part: Path) -> None:
        scene = read_colmap(work.path / "sparse" / "0")
        detector = load_detector(options.detector, options.detector_labels)
        instances, warnings = detect_instances(scene, work.path / "frames", detector)
        for line in warnings:
            sys.stderr.write(f"estimate-scale: warning: {line}\n")
        write_instances(instances, scene, part / INSTANCES)

    file, labels = Path(options.detector), options.detector_labels
    inputs = {
        "detector": content_digest(file) if file.is_file() else str(options.detector),
        "labels": None if labels is None else read_text(labels, MAX_LABEL_BYTES),
        "model": content_digest(work.path / "sparse"),
    }
    work.stage("instances", inputs, [INSTANCES], make)


def _draw(options: Namespace, work: WorkFolder) -> None:
    """Instances that a person draws on a page; only where somebody is there to do it."""
    if options.draw is None and not (sys.stdin.isatty() and sys.stderr.isatty()):
        _say_what_is_missing(options, work)
    import metric_tree
    from estimator.capture.mask_page import MaskPage, frames_to_draw
    from estimator.capture.thing_names import ThingNames
    from estimator.reconstructions.colmap import read_colmap
    from metric_base.files import whole_file
    from taxonomy.label_lists import vocabulary

    frames = frames_to_draw(read_colmap(work.path / "sparse" / "0"), work.path / "frames")
    names = [label.label for label in vocabulary("coco_80")]
    page = MaskPage(frames, names, work.path / DRAFT, ThingNames(metric_tree.open(options.tree)), options.draw or 0)
    sys.stderr.write(f"estimate-scale: draw round the things and name them: {page.url} (Ctrl-C ends)\n")
    sys.stderr.flush()
    document = page.collect()
    work.discard_stale("instances", {"drawn": document}, [])  # what stands there now is of no file
    with whole_file(work.path / INSTANCES, "--work") as file:
        file.write_text(json.dumps(document) + "\n", encoding="utf-8")


def _say_what_is_missing(options: Namespace, work: WorkFolder) -> NoReturn:
    ways = "--instances FILE, --detector MODEL, or --draw to draw the things on a page in a browser"
    words = f"none; the frames are in {work.path / 'frames'}"
    raise InputError.at(options.scene, "instances", ways, Unquoted(words))
