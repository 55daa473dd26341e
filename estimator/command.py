"""The `estimate-scale` command: arguments in, one result out; everything heavy is imported where it is used."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from metric_base.escaping import visible_json
from metric_base.faults import InputFault

if TYPE_CHECKING:
    from estimator.records.result import ScaleResult
    from estimator.results.reports import Options
    from estimator.results.scene_estimate import SceneEstimate
    from metric_tree.tree import Tree

__all__ = ["main", "parser"]

PROGRAM = "estimate-scale"

METHODS = ("default", "paper", "sucar", "height")
#: The baselines know objects alone.
WITHOUT_LENGTHS = ("paper", "sucar")

EPILOG = """\
Exit status: 0 done; 2 the input is at fault (one line says where); 3 unresolved: no usable object, or the interval's
high/low exceeds 1.8, or a mode more than 25 % away has mass of 0.1 or more, or a known length contradicts every
object; 1 a fault of the program.
"""

#: Where a user says how many threads NumPy's BLAS takes.
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

#: A coordinate list that begins with a minus sign; argparse would take it for an option.
NEGATIVE = re.compile(r"^-[\d.]")


def main(argv: Sequence[str] | None = None) -> int:
    """Run `estimate-scale`; the exit status is 0, 2, 3 or 1 (docs/reference/formats.md)."""
    _use_one_thread()
    from metric_base.terminal import exit_status

    words = list(sys.argv[1:] if argv is None else argv)
    return exit_status(PROGRAM, lambda: _run(words))


def parser() -> argparse.ArgumentParser:
    """The argument parser; `docs/reference/commands.md` shows its help."""
    from metric_base.terminal import version

    root = argparse.ArgumentParser(
        prog=PROGRAM,
        description="The metric scale of a reconstruction from the sizes of the things that are in it.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = root.add_argument
    add("scene", metavar="SCENE", nargs="?", type=Path, help="COLMAP model or OpenSfM folder, a video, or pictures")
    add("--objects", metavar="FILE", type=Path, help="sizes measured elsewhere (metric-tree/objects/1), no geometry")
    add("--instances", metavar="FILE", type=Path, help="COCO dataset or results, or a folder of instance pictures")
    add("--categories", metavar="FILE", type=Path, help="COCO dataset that names categories and images, for results")
    add("--images", metavar="DIR", type=Path, help="the scene's pictures, for --detector")
    add("--detector", metavar="MODEL", help="ONNX Mask R-CNN in torchvision's form, or a registered name to download")
    add("--detector-labels", metavar="FILE", type=Path, help="its label names, one a line from label 1 (default: COCO)")
    add("--dense", metavar="FILE|none", help="dense cloud (default: the one beside the model, if any)")
    add("--work", metavar="DIR", type=Path, help="of a video or pictures: keeps every stage and resumes")
    add("--frames", metavar="N", type=int, help="of a video or pictures: frames to use (default: by the motion)")
    add("--focal", metavar="PX", type=float, help="of a video or pictures: focal length in pixels, not refined")
    add("--camera-model", metavar="M", help="of a video or pictures: COLMAP's camera model (default: SIMPLE_RADIAL)")
    draw = "of a video or pictures: draw the instances on a page that is served on loopback"
    add("--draw", metavar="PORT", nargs="?", const=0, type=int, help=draw)
    add("--tree", metavar="REF", help="release: a version or a folder (default: the newest at hand)")
    add("--method", choices=METHODS, default="default", help="estimator (default: %(default)s)")
    add(
        "--known-length",
        metavar="VALUE",
        nargs="+",
        action="append",
        default=[],
        help="a length known in metres, after SCENE, as A B METRES (points as x,y,z) or a file; may be repeated",
    )
    trust = "believe a known length that contradicts most objects (otherwise unresolved)"
    add("--trust-known-length", action="store_true", help=trust)
    add("--level", type=float, default=0.9, help="mass of the interval (default: %(default)s)")
    add("--leave-one-class-out", action="store_true", help="the scale without each class in turn")
    add("--paper-lists", metavar="DIR", type=Path, help="--method paper with the authors' own lists (scale_metrics)")
    add("--json", action="store_true", help="print the result as JSON (metric-tree/scale/1)")
    add("--output", metavar="FILE", type=Path, help="write the JSON result there as well")
    add("--figure", metavar="FILE", type=Path, help="draw the posterior and the objects; of a SCENE its plan too")
    add("--overlay", metavar="DIR", type=Path, help="draw the boxes with their sizes into every frame")
    add("--write-scaled", metavar="DIR", type=Path, help="write the model again at metric scale")
    add("--version", action="version", version=f"{PROGRAM} {version()}")
    return root


def _use_one_thread() -> None:
    """Before NumPy is loaded: its products are small here, and threads that wait for them cost more than they do."""
    if not any(name in os.environ for name in THREAD_VARIABLES):
        os.environ[THREAD_VARIABLES[0]] = "1"


def _run(words: Sequence[str]) -> int:
    from metric_base.terminal import warn

    # argparse takes "-1,2,3" for an option; with a blank before it, it is a value, and float() skips the blank
    options = parser().parse_args([f" {word}" if NEGATIVE.match(word) else word for word in words])
    _checked(options)
    if (status := _capture_status(options)) is not None:
        return status
    result = _objects_result(options) if options.objects is not None else _scene_result(options)
    for line in result.warnings:
        warn(line, PROGRAM)
    for file in (options.output, options.work and options.work / "result.json"):
        if file is not None and result.exit_code == 0:
            result.save(file)
    _print(result, options.json)
    return result.exit_code


def _capture_status(options: argparse.Namespace) -> int | None:
    """The exit status of a video or pictures that cannot be used; None where there is a scene to go on with."""
    from estimator.capture.preparation import failure_json, prepare_capture

    failure = prepare_capture(options)
    if failure is None:
        return None
    sys.stderr.write(f"{PROGRAM}: {failure.code}: {failure.message}\n")
    if options.json:
        sys.stdout.write(failure_json(failure) + "\n")
    return 3


def _checked(options: argparse.Namespace) -> None:
    _check_known_lengths(options)  # before the SCENE, which one may have swallowed
    if (options.scene is None) == (options.objects is None):
        found = "neither" if options.scene is None else "both"
        raise InputFault(f"arguments: expected a SCENE or --objects FILE; found {found}")
    if not 0 < options.level < 1:
        raise InputFault(f"--level: expected a number between 0 and 1; found {options.level}")
    if options.paper_lists is not None and options.method != "paper":
        raise InputFault(f"--paper-lists: expected --method paper; found --method {options.method}")
    _check_detector(options)
    geometric = {"--overlay": options.overlay, "--write-scaled": options.write_scaled}
    for name, value in geometric.items():
        if value is not None and options.objects is not None:
            raise InputFault(f"{name}: expected a SCENE; found --objects")
    for name in ("output", "figure"):
        path = getattr(options, name)
        if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
            raise InputFault(f"--{name}: expected a file in a folder that exists; found {path}")
    for name in ("overlay", "write_scaled"):
        path = getattr(options, name)
        if path is not None and path.exists():  # said before the work is done, not after
            raise InputFault(f"--{name.replace('_', '-')}: expected a folder that is not there yet; found {path}")


def _check_known_lengths(options: argparse.Namespace) -> None:
    for words in options.known_length:
        if len(words) not in (1, 3):
            expected = "three values, A B METRES, or one FILE, with SCENE before the option"
            raise InputFault(f"--known-length: expected {expected}; found {len(words)}: {' '.join(words)}")
    if options.known_length and options.method in WITHOUT_LENGTHS:
        raise InputFault(f"--known-length: expected --method default or height; found --method {options.method}")


def _check_detector(options: argparse.Namespace) -> None:
    if options.work is None and (options.images is None) != (options.detector is None):
        found = "--images" if options.detector is None else "--detector"
        raise InputFault(f"arguments: expected --images and --detector together; found {found} alone")
    if options.detector_labels is not None and options.detector is None:
        raise InputFault("--detector-labels: expected --detector; found none")
    others = {"--instances": options.instances, "--categories": options.categories, "--objects": options.objects}
    for name, value in others.items():
        if options.detector is not None and value is not None:
            raise InputFault(f"--detector: expected no {name}; found both")


def _objects_result(options: argparse.Namespace) -> ScaleResult:
    from estimator.pipeline import objects_result
    from estimator.reconstructions.objects_file import read_objects

    if options.method == "sucar":
        raise InputFault("--method sucar: expected a SCENE (it needs boxes in frames); found --objects")
    asked = _asked(options)
    result = objects_result(read_objects(options.objects), _tree(options), asked, options.paper_lists)
    if options.figure is not None and result.exit_code == 0:
        from estimator.outputs.figure import write_figure

        write_figure(result, options.figure)
    return result


def _scene_result(options: argparse.Namespace) -> ScaleResult:
    from estimator.pipeline import scene_estimate

    asked = _asked(options)
    detector = None
    if options.detector is not None:
        from estimator.instances.detector import load_detector

        detector = load_detector(options.detector, options.detector_labels)
    estimate = scene_estimate(
        options.scene,
        _tree(options),
        asked,
        instances=options.instances,
        categories=options.categories,
        dense=options.dense,
        paper_lists=options.paper_lists,
        images=options.images,
        detector=detector,
    )
    if estimate.result.exit_code == 0:
        _write_pictures(options, estimate)
    return estimate.result


def _write_pictures(options: argparse.Namespace, estimate: SceneEstimate) -> None:
    """Figure, overlay and scaled model; of an unresolved scene nothing is written."""
    scale = estimate.result.scale
    if options.figure is not None:
        from estimator.outputs.figure import write_figure

        write_figure(estimate, options.figure)
    if options.overlay is not None:
        from estimator.outputs.overlay import write_overlays

        write_overlays(estimate, options.overlay)
    if options.write_scaled is not None and scale is not None:
        from estimator.outputs.rescaled import write_scaled

        write_scaled(estimate.scene, scale, options.write_scaled)


def _tree(options: argparse.Namespace) -> Tree:
    import metric_tree

    return metric_tree.open(options.tree)


def _asked(options: argparse.Namespace) -> Options:
    from estimator.evidence.lengths import known_length_evidence
    from estimator.reconstructions.known_lengths import parse_known_lengths
    from estimator.results.reports import Options

    lengths = [length for words in options.known_length for length in parse_known_lengths(words)]
    return Options(
        method=options.method,
        level=options.level,
        evidence=known_length_evidence(lengths),
        trust_known_length=options.trust_known_length,
        leave_one_class_out=options.leave_one_class_out,
    )


def _print(result: ScaleResult, as_json: bool) -> None:
    if as_json:
        sys.stdout.write(visible_json(result.json()) + "\n")
        return
    from estimator.outputs.table import result_text

    sys.stdout.write(result_text(result))
