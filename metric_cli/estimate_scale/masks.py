"""The masks of a video or of pictures: given, detected, or drawn on a page."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from metric_base.errors import InputError, Unquoted
from metric_cli.estimate_scale.options import DRAFT, PROGRAM
from metric_cli.terminal import warn

if TYPE_CHECKING:
    from estimator.capture.work_folder import WorkFolder

__all__ = ["notice", "prepare_masks"]

#: Of the options and the folder of a scene, what the drawing page shows: a record and the figure.
Preview = Callable[[Namespace, Path], tuple[dict[str, Any], bytes]]


def prepare_masks(options: Namespace, work: WorkFolder, preview: Preview) -> None:
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
        return preview(options, work.path)

    page = MaskPage(frames, names, work.path / DRAFT, look_up, options.draw or 0, estimate)
    notice(f"draw round the objects and name them: {page.url} (Ctrl-C ends)")
    save_drawing(page.collect(), work)


def notice(sentence: str) -> None:
    """One line on standard error about how the work is done."""
    sys.stderr.write(f"{PROGRAM}: {sentence}\n")
    sys.stderr.flush()


def _say_what_is_missing(options: Namespace, work: WorkFolder) -> NoReturn:
    ways = "--instances FILE, --detector MODEL, or --draw to draw the objects on a page in a browser; or other evidence"
    words = f"none; the frames are in {work.path / 'frames'}"
    raise InputError.at(options.scene, "instances", ways, Unquoted(words))
