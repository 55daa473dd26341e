"""What `estimate-scale` does with a video or pictures before it has a scene: reconstruct, find instances."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, NoReturn

from estimator.capture.frames import FRAMES_FILE, is_capture
from metric_base.errors import InputError, Unquoted
from metric_base.outputs import check_output
from metric_cli.estimate_scale.options import RESULT
from metric_cli.terminal import warn

if TYPE_CHECKING:
    from estimator.capture.mapping.failures import Failure
    from estimator.capture.work_folder import WorkFolder

__all__ = ["check_capture", "failure_json", "prepare_capture", "work_lock"]

PROGRAM = "estimate-scale"
#: Of the options of a scene, what the drawing page shows: a record and the figure.
Preview = Callable[[Namespace], tuple[dict[str, Any], bytes]]
#: What was drawn so far, kept over an interruption.
DRAFT, DRAWING_SCHEMA = "drawing.json", "metric-tree/drawing/1"
#: Options that mean something only for a video or pictures.
_CAPTURE_OPTIONS = ("--work", "--frames", "--focal", "--camera-model", "--max-time", "--draw")


def work_lock(options: Namespace) -> AbstractContextManager[None]:
    """The lock of the work folder, held until the answer is written; nothing where there is no work folder."""
    if options.work is None or options.scene is None or not is_capture(options.scene):
        return nullcontext()
    from estimator.capture.work_folder import WorkFolder

    return WorkFolder(options.work).lock()


def prepare_capture(options: Namespace, preview: Preview) -> Failure | None:
    """Turn a video or a folder of pictures into a scene: `options` then names the work folder as SCENE.

    Options of a reconstruction are left as they are. A capture that cannot be used gives its failure; the command
    ends with status 3. The caller holds `work_lock`. `preview` estimates from a drawing before it is done.

    Raises
    ------
    InputError
        A video that cannot be read, or no instances.
    """
    if options.scene is None or not is_capture(options.scene):
        options.dense = _dense_of(options)
        return None
    from estimator.capture.capture import CaptureOptions, reconstruct
    from estimator.capture.mapping.failures import CaptureFailure
    from estimator.capture.work_folder import WorkFolder
    from metric_cli.progress import progress_bars

    dense = options.dense == "auto"
    capture = CaptureOptions(options.frames, options.focal, options.camera_model, dense, options.max_time)
    work = WorkFolder(options.work)
    with progress_bars() as shown:
        try:
            reconstruct(options.scene, work, capture, shown, _notice)
        except CaptureFailure as refusal:
            return refusal.failure
    _prepare_instances(options, work, preview)
    options.scene = work.path
    options.dense = _dense_of(options)
    return None


def check_capture(options: Namespace) -> None:
    """InputError for options that do not go with the SCENE: said before any work."""
    if options.scene is None or not is_capture(options.scene):
        for name in _CAPTURE_OPTIONS:
            if getattr(options, name.strip("-").replace("-", "_")) is not None:
                words = Unquoted(str(options.scene or options.objects))
                raise InputError.at("arguments", name, "a video or a folder of pictures as SCENE", words)
        return
    if options.draw is not None and not 0 <= options.draw < 1 << 16:
        raise InputError.at("--draw", "port", "a number from 0 to 65535", options.draw)
    if options.work is None:
        raise InputError.at(options.scene, "--work", "a folder for frames, reconstruction and result", Unquoted("none"))
    # said before the reconstruction, not after
    check_output(options.work / RESULT, "--work", "metric-tree/scale/")
    check_output(options.work / DRAFT, "--work", DRAWING_SCHEMA)
    for file in (options.instances, options.categories, options.detector_labels):
        if file is not None and not file.exists():
            raise InputError.at(file, "file", "a readable file", Unquoted("no such file"))


def failure_json(failure: Failure) -> str:
    """The result of a capture that cannot be used."""
    record = {"schema": "metric-tree/scale/1", "status": "unresolved", "failure": failure.json()}
    return json.dumps(record, indent=1, ensure_ascii=False)


def _dense_of(options: Namespace) -> str | None:
    """The cloud to measure from: in a work folder none but one that is named.

    The dense points of a work folder are for what is drawn. They have been better and worse than the sparse ones
    (docs/evidence/videos.md), on too few scenes to be the default.
    """
    if options.dense not in (None, "auto"):
        return str(options.dense)
    is_work_folder = options.scene is not None and (options.scene / FRAMES_FILE).is_file()
    return "none" if is_work_folder else None


def _prepare_instances(options: Namespace, work: WorkFolder, preview: Preview) -> None:
    """`instances.json` in the work folder: given, detected, drawn on a page, or made before."""
    from estimator.capture.instances_file import INSTANCES, copy_dataset, detect_stage
    from metric_cli.progress import progress_bars

    beside = options.scene / INSTANCES
    if options.detector is not None:
        with progress_bars() as shown:
            detect_stage(options.detector, options.detector_labels, work, shown, lambda line: warn(line, PROGRAM))
        options.detector = options.images = None
    elif options.instances is not None or (options.scene.is_dir() and beside.is_file()):
        file = options.instances or beside
        if file.is_file() and options.categories is None:
            options.instances = None if copy_dataset(file, work) else file
    elif options.draw is not None or not ((work.path / INSTANCES).is_file() or _needs_no_masks(options, work)):
        _draw(options, work, preview)


def _needs_no_masks(options: Namespace, work: WorkFolder) -> bool:
    """Whether other evidence is asked for or, where nobody is there to draw masks, is in the files."""
    from metric_cli.estimate_scale.evidence_options import asks_for_evidence, has_evidence

    return asks_for_evidence(options) or (not _is_interactive() and has_evidence(options, work.path))


def _is_interactive() -> bool:
    return sys.stdin.isatty() and sys.stderr.isatty()


def _draw(options: Namespace, work: WorkFolder, preview: Preview) -> None:
    """Instances that a person draws on a page; only where somebody is there to do it."""
    if options.draw is None and not _is_interactive():
        _say_what_is_missing(options, work)
    import metric_tree
    from estimator.capture.instances_file import save_drawing
    from estimator.capture.mask_page import MaskPage, frames_to_draw
    from estimator.capture.object_names import ObjectNames
    from estimator.reconstructions.colmap import read_colmap
    from taxonomy.label_lists import vocabulary

    frames = frames_to_draw(read_colmap(work.path / "sparse" / "0"), work.path / "frames")
    names = [label.label for label in vocabulary("coco_80")]
    look_up = ObjectNames(metric_tree.open(options.tree))

    def estimate(document: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        save_drawing(document, work)
        asked = Namespace(**{**vars(options), "scene": work.path})
        asked.dense = _dense_of(asked)
        return preview(asked)

    page = MaskPage(frames, names, work.path / DRAFT, look_up, options.draw or 0, estimate)
    _notice(f"draw round the objects and name them: {page.url} (Ctrl-C ends)")
    save_drawing(page.collect(), work)


def _notice(sentence: str) -> None:
    sys.stderr.write(f"{PROGRAM}: {sentence}\n")
    sys.stderr.flush()


def _say_what_is_missing(options: Namespace, work: WorkFolder) -> NoReturn:
    ways = "--instances FILE, --detector MODEL, or --draw to draw the objects on a page in a browser; or other evidence"
    words = f"none; the frames are in {work.path / 'frames'}"
    raise InputError.at(options.scene, "instances", ways, Unquoted(words))
