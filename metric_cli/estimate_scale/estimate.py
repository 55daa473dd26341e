"""The `estimate-scale` command: arguments in, one result out; everything heavy is imported where it is used."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from metric_base.errors import InputError
from metric_base.escaping import visible_json
from metric_base.outputs import is_own_output
from metric_cli.estimate_scale.options import PROGRAM, RESULT, has_capture, parse_options, parser
from metric_cli.terminal import UNUSABLE
from metric_cli.threads import use_one_thread

if TYPE_CHECKING:
    from estimator.capture.mapping.failures import Failure
    from estimator.records.result import ScaleResult
    from estimator.records.scene import Scene
    from estimator.results.reports import EstimateOptions
    from estimator.results.scene_estimate import SceneEstimate
    from metric_tree.tree import Tree

__all__ = ["main", "parser"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run `estimate-scale`; the exit status is 0, 2, 3 or 1 (docs/reference/formats.md)."""
    use_one_thread()
    from metric_cli.terminal import exit_status

    words = list(sys.argv[1:] if argv is None else argv)
    return exit_status(PROGRAM, lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    options = parse_options(words)
    if not has_capture(options):
        return _answer(options)
    from estimator.capture.work_folder import WorkFolder

    with WorkFolder(options.work).lock():  # until the answer is written: a second run would exchange the masks under it
        return _answer(options)


def _answer(options: argparse.Namespace) -> int:
    """Estimate, write and print; the exit status."""
    from metric_cli.terminal import warn

    if (failure := _prepare_scene(options)) is not None:
        return _report_failure(failure, options)
    result = _objects_result(options) if options.objects is not None else _scene_result(options)
    result = replace(result, warnings=(*_cautions(options), *result.warnings))
    for line in () if options.quiet else result.warnings:
        warn(line, PROGRAM)
    if result.status != "unresolved":
        for option, file in (("--output", options.output), ("--work", options.work and options.work / RESULT)):
            if file is not None:
                result.save(file, option)
    else:
        _withhold_files(options)
    _print(result, options)
    refused = {"unresolved", "uncertain"} if options.strict else {"unresolved"}
    return UNUSABLE if result.status in refused else 0


def _withhold_files(options: argparse.Namespace) -> None:
    """Say what is not written, and remove what an earlier run of the work folder found, which no longer holds."""
    from metric_cli.terminal import warn

    if options.work is not None and is_own_output(options.work / RESULT):
        (options.work / RESULT).unlink()
    asked = [name for name in ("output", "write_scaled") if getattr(options, name) is not None]
    if asked and not options.quiet:
        names = ", ".join(f"--{name.replace('_', '-')}" for name in asked)
        warn(f"{names}: not written: the scale is unresolved", PROGRAM)


def _prepare_scene(options: argparse.Namespace) -> Failure | None:
    """Make a scene of a video or of pictures: `options` then names the work folder as SCENE.

    Options of a reconstruction are left as they are. A capture that cannot be used gives its failure. The caller holds
    the lock of the work folder.
    """
    if not has_capture(options):
        options.dense = _dense_of(options)
        return None
    from estimator.capture.capture import CaptureOptions, reconstruct
    from estimator.capture.mapping.failures import CaptureFailure
    from estimator.capture.work_folder import WorkFolder
    from metric_cli.estimate_scale.masks import notice, prepare_masks
    from metric_cli.progress import progress_bars

    dense = options.dense == "auto"
    capture = CaptureOptions(options.frames, options.focal, options.camera_model, dense, options.max_time)
    work = WorkFolder(options.work)
    with progress_bars() as shown:
        try:
            reconstruct(options.scene, work, capture, shown, notice)
        except CaptureFailure as refusal:
            return refusal.failure
    prepare_masks(options, work, _preview)
    options.scene = work.path
    options.dense = _dense_of(options)
    return None


def _dense_of(options: argparse.Namespace) -> str | None:
    """The cloud to measure from: in a work folder none but one that is named.

    The dense points of a work folder are for what is drawn. They have been better and worse than the sparse ones
    (docs/evidence/videos.md), on too few scenes to be the default.
    """
    if options.dense not in (None, "auto"):
        return str(options.dense)
    from estimator.capture.frames import FRAMES_FILE

    is_work_folder = options.scene is not None and (options.scene / FRAMES_FILE).is_file()
    return "none" if is_work_folder else None


def _report_failure(failure: Failure, options: argparse.Namespace) -> int:
    """Say why a capture cannot be used; the exit status."""
    sys.stderr.write(f"{PROGRAM}: {failure.code}: {failure.message}\n")
    if options.json:
        record = {"schema": "metric-tree/scale/1", "status": "unresolved", "failure": failure.json()}
        sys.stdout.write(json.dumps(record, indent=1, ensure_ascii=False) + "\n")
    return UNUSABLE


def _cautions(options: argparse.Namespace) -> tuple[str, ...]:
    """What the reconstruction of a video or of pictures has to say about every result that rests on it."""
    if options.scene is None:
        return ()
    from estimator.capture.cautions import read_cautions

    return read_cautions(options.scene)


def _objects_result(options: argparse.Namespace) -> ScaleResult:
    from estimator.pipeline import objects_result
    from estimator.reconstructions.objects_file import read_objects

    if options.method == "sucar":
        raise InputError("--method sucar: expected a SCENE (it needs boxes in frames); found --objects")
    asked = _estimate_options(options)
    result = objects_result(read_objects(options.objects), _tree(options), asked, options.paper_lists)
    from metric_cli.estimate_scale.pictures import is_drawable

    if options.figure is not None and is_drawable(result, options):
        from estimator.outputs.figure import write_figure

        write_figure(result, options.figure)
    return result


def _scene_result(options: argparse.Namespace) -> ScaleResult:
    from estimator.scene_reading import read_scene

    scene = read_scene(options.scene, options.dense)
    if options.view:
        from estimator.views.window import check_display

        check_display()
    if options.overlay is not None:
        from estimator.outputs.overlay import view_pictures

        view_pictures(scene, options.images)  # said before the work is done, not after
    estimate = _scene_estimate(options, scene)
    from metric_cli.estimate_scale.pictures import write_pictures

    write_pictures(options, estimate)
    return estimate.result


def _scene_estimate(options: argparse.Namespace, scene: Scene) -> SceneEstimate:
    from estimator.pipeline import scene_estimate
    from metric_cli.estimate_scale.evidence_options import automatic_sources, evidence_sources

    detector = None
    if options.detector is not None:
        from estimator.detectors.detector import load_detector

        detector = load_detector(options.detector, options.detector_labels)
    return scene_estimate(
        scene,
        _tree(options),
        _estimate_options(options),
        instances=options.instances,
        categories=options.categories,
        paper_lists=options.paper_lists,
        images=options.images,
        detector=detector,
        sources=(*evidence_sources(options), *automatic_sources(options, scene)),
    )


def _preview(options: argparse.Namespace, scene: Path) -> tuple[dict[str, object], bytes]:
    """What the drawing page shows of a work folder's scene: the record, and the figure as PNG."""
    from estimator.outputs.figure import figure_png
    from estimator.scene_reading import read_scene
    from metric_cli.estimate_scale.result_table import page_record

    asked = argparse.Namespace(**{**vars(options), "scene": scene})
    estimate = _scene_estimate(asked, read_scene(scene, _dense_of(asked)))
    return page_record(estimate.result), figure_png(estimate) if estimate.result.curve is not None else b""


def _tree(options: argparse.Namespace) -> Tree:
    import metric_tree

    return metric_tree.open(options.tree)


def _estimate_options(options: argparse.Namespace) -> EstimateOptions:
    from estimator.evidence.known_lengths import known_length_evidence, parse_known_lengths
    from estimator.results.reports import EstimateOptions
    from metric_cli.estimate_scale.evidence_options import up_direction
    from metric_tree.context import where_of

    lengths = [length for words in options.known_length for length in parse_known_lengths(words)]
    return EstimateOptions(
        method=options.method,
        level=options.level,
        evidence=known_length_evidence(lengths),
        trust_known_length=options.trust_known_length,
        up=up_direction(options),
        leave_one_class_out=options.leave_one_class_out,
        where=None if options.where is None else where_of(options.where),
    )


def _print(result: ScaleResult, options: argparse.Namespace) -> None:
    from metric_cli.estimate_scale.result_table import csv_text, headline, result_text

    if options.json:
        text = visible_json(result.json()) + "\n"
    elif options.csv:
        text = csv_text(result)
    else:
        text = f"{headline(result)}\n" if options.quiet else result_text(result, wide=options.wide)
    sys.stdout.write(text)
