"""The options of `estimate-scale`, and what is wrong with them before any work is done."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from estimator.records import METHODS
from metric_base.errors import InputError, Unquoted
from metric_base.outputs import check_output
from metric_cli.arguments import OutputFile, input_path, new_folder, output_folder
from metric_cli.estimate_scale.evidence_options import add_evidence_options, evidence_sources, up_direction
from metric_cli.parsers import add_program_options, program_parser
from metric_cli.terminal import UNUSABLE, OneLineParser, statuses_text

__all__ = ["DRAFT", "PROGRAM", "RESULT", "has_capture", "parse_options", "parser"]

PROGRAM = "estimate-scale"
#: The answer in a work folder.
RESULT = "result.json"
#: What was drawn so far, kept over an interruption.
DRAFT, DRAWING_SCHEMA = "drawing.json", "metric-tree/drawing/1"
#: Options that mean something only for a video or pictures.
_CAPTURE_OPTIONS = ("--work", "--frames", "--focal", "--camera-model", "--max-time", "--draw")

#: The baselines know objects alone.
WITHOUT_LENGTHS = ("paper", "sucar")

EPILOG = statuses_text(
    done=", with a warning where the scale is uncertain: the interval's high/low exceeds 1.8, or a mode more than 25 % "
    f"away has mass of 0.1 or more (--strict: {UNUSABLE})",
    unusable="unresolved: no usable object, or less than 35 % of the posterior is within 15 % of its highest mode, or "
    "a known length contradicts the objects, or the reconstruction or the masks contradict themselves",
)


def parse_options(words: Sequence[str]) -> argparse.Namespace:
    """The options of a command line.

    Raises
    ------
    InputError
        An option is unknown, lacks its value, or does not go with the others.
    """
    options: argparse.Namespace = parser().parse_args(words)
    _check(options)
    _check_capture(options)
    return options


def has_capture(options: argparse.Namespace) -> bool:
    """Whether SCENE is a video or a folder of pictures."""
    from estimator.capture.frames import is_capture

    return options.scene is not None and is_capture(options.scene)


def parser() -> OneLineParser:
    """The argument parser; `docs/reference/commands.md` shows its help."""
    root = program_parser(PROGRAM, "The metric scale of a reconstruction from the sizes of the objects in it.", EPILOG)
    add = root.add_argument
    add("scene", metavar="SCENE", nargs="?", type=input_path, help="reconstruction, a video, or pictures")
    add(
        "--objects",
        metavar="FILE",
        type=input_path,
        help="sizes measured elsewhere (metric-tree/objects/1; - is stdin)",
    )
    add("--instances", metavar="FILE", type=input_path, help="masks: COCO, label images, YOLO, labelme, NumPy")
    add("--categories", metavar="FILE", type=input_path, help="file that names categories, for masks that lack them")
    add(
        "--images",
        metavar="DIR",
        type=input_path,
        help="the scene's pictures, for --detector, --overlay, --gps exif, --marker",
    )
    add("--detector", metavar="MODEL", help="ONNX Mask R-CNN, YOLO or RT-DETR, or a registered name to download")
    add(
        "--detector-labels",
        metavar="FILE",
        type=input_path,
        help="its label names, one a line from label 1 (default: COCO)",
    )
    dense = "dense cloud (default: the one beside the model, if any; auto: make one, for a video or pictures)"
    add("--dense", metavar="FILE|none|auto", help=dense)
    add("--work", metavar="DIR", type=output_folder, help="for a video or pictures: folder that keeps every stage")
    add("--frames", metavar="N", type=int, help="for a video or pictures: frames to use (default: by the motion)")
    add("--focal", metavar="PX", type=float, help="for a video or pictures: focal length in pixels, not refined")
    add(
        "--camera-model",
        metavar="M",
        help="for a video or pictures: COLMAP's camera model (default: the one that fits)",
    )
    slowest = (
        "for a video or pictures: wall seconds for the reconstruction (default: 900 of processor time, or 6 a frame "
        "if that is more)"
    )
    add("--max-time", metavar="S", type=float, help=slowest)
    draw = "for a video or pictures: draw the instances on a page that is served on loopback"
    add("--draw", metavar="PORT", nargs="?", const=0, type=int, help=draw)
    add("--tree", metavar="REF", help="release: a version or a folder (default: the newest available)")
    add("--where", metavar="region=R,year=Y", help="region and year of the scene: region=europe,year=2011")
    add("--method", choices=METHODS, default="default", help="estimator (default: %(default)s)")
    add(
        "--known-length",
        metavar="VALUE",
        nargs="+",
        action="append",
        default=[],
        help="a length known in metres, after SCENE, as A B METRES (points as x,y,z) or a file; may be repeated",
    )
    trust = "use a known length even if it contradicts most objects (otherwise unresolved)"
    add("--trust-known-length", action="store_true", help=trust)
    add("--strict", action="store_true", help=f"exit {UNUSABLE} of an uncertain scale too")
    add("--level", type=float, default=0.9, help="mass of the interval (default: %(default)s)")
    add("--leave-one-class-out", action="store_true", help="the scale without each class in turn")
    add(
        "--paper-lists",
        metavar="DIR",
        type=input_path,
        help="--method paper with the authors' own lists (scale_metrics)",
    )
    add("--json", action="store_true", help="print the result as JSON (metric-tree/scale/1)")
    add("--output", metavar="FILE", type=OutputFile("metric-tree/scale/"), help="write the JSON result there as well")
    add(
        "--figure",
        metavar="FILE",
        type=OutputFile(),
        help="draw the posterior and the objects; for a SCENE, its plan too",
    )
    add("--overlay", metavar="DIR", type=new_folder, help="draw the boxes with their sizes into every frame")
    add("--view", action="store_true", help="show points, cameras, boxes and planes in a window (extra view)")
    add("--view-png", metavar="FILE", type=OutputFile(), help="the same as a picture, drawn without a display")
    add("--view-glb", metavar="FILE", type=OutputFile(), help="the same as glTF, for Blender and the explorer's page")
    add("--write-scaled", metavar="DIR", type=new_folder, help="write the model again at metric scale")
    add("--csv", action="store_true", help="print the objects as CSV")
    add("--wide", action="store_true", help="print the node, the units and the weight of each object too")
    add("--quiet", action="store_true", help="print the scale alone, and no warnings")
    add_evidence_options(root)
    add_program_options(root)
    return root


def _check(options: argparse.Namespace) -> None:
    _check_known_lengths(options)  # before the SCENE, which one may have swallowed
    if (options.scene is None) == (options.objects is None):
        sources = "neither" if options.scene is None else "both"
        raise InputError(f"arguments: expected a SCENE or --objects FILE; found {sources}")
    if not 0 < options.level < 1:
        raise InputError(f"--level: expected a number between 0 and 1; found {options.level}")
    _check_where(options)
    if options.paper_lists is not None and options.method != "paper":
        raise InputError(f"--paper-lists: expected --method paper; found --method {options.method}")
    _check_detector(options)
    up_direction(options)
    evidence_sources(options)  # a value that cannot be read is said before the work is done
    geometric = {
        "--overlay": options.overlay,
        "--write-scaled": options.write_scaled,
        "--view": options.view or None,
        "--view-png": options.view_png,
        "--view-glb": options.view_glb,
    }
    for name, value in geometric.items():
        if value is not None and options.objects is not None:
            raise InputError(f"{name}: expected a SCENE; found --objects")
    _check_outputs(options)


def _check_outputs(options: argparse.Namespace) -> None:
    """InputError for an output that cannot be written, or that would take the place of an input."""
    files: dict[Path, str] = {}
    for name in ("output", "figure", "view_png", "view_glb"):
        path, option = getattr(options, name), f"--{name.replace('_', '-')}"
        if path is None:
            continue
        if path.is_dir() or not path.absolute().parent.is_dir():
            raise InputError(f"{option}: expected a file in a folder that exists; found {path}")
        if (other := files.setdefault(path.resolve(), option)) != option:
            raise InputError(f"{option}: expected another file than that of {other}; found {path}")
    for name, path, ending in (("png", options.view_png, ".png"), ("glb", options.view_glb, ".glb")):
        if path is not None and path.suffix.lower() != ending:
            raise InputError(f"--view-{name}: expected a name that ends with {ending}; found {path}")


def _check_known_lengths(options: argparse.Namespace) -> None:
    for words in options.known_length:
        if len(words) not in (1, 3):
            expected = "three values, A B METRES, or one FILE, with SCENE before the option"
            raise InputError(f"--known-length: expected {expected}; found {len(words)}: {' '.join(words)}")
    if options.known_length and options.method in WITHOUT_LENGTHS:
        raise InputError(f"--known-length: expected --method default or height; found --method {options.method}")


def _check_where(options: argparse.Namespace) -> None:
    if options.where is None:
        return
    from metric_tree.context import where_of

    where_of(options.where)
    if options.method in WITHOUT_LENGTHS:
        raise InputError(f"--where: expected --method default or height; found --method {options.method}")


def _check_detector(options: argparse.Namespace) -> None:
    if options.work is None and options.detector is not None and options.images is None:
        raise InputError("arguments: expected --images and --detector together; found --detector alone")
    uses = (options.detector, options.overlay, options.gps, *options.marker)
    if options.work is None and options.images is not None and all(use is None for use in uses):
        raise InputError(
            "arguments: expected --images with --detector, --overlay, --gps or --marker; found --images alone"
        )
    if options.images is not None and not options.images.is_dir():
        raise InputError(f"--images: expected a folder of pictures; found no folder {options.images}")
    if options.detector_labels is not None and options.detector is None:
        raise InputError("--detector-labels: expected --detector; found none")
    others = {"--instances": options.instances, "--categories": options.categories, "--objects": options.objects}
    for name, value in others.items():
        if options.detector is not None and value is not None:
            raise InputError(f"--detector: expected no {name}; found both")


def _check_capture(options: argparse.Namespace) -> None:
    """InputError for options that do not go with the SCENE: said before any work."""
    if not has_capture(options):
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
