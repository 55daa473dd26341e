"""The `insert-object` command: arguments in, images and a result out; heavy imports wait until they are used."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from metric_base.errors import InputError
from metric_cli.errors import statuses_text
from metric_cli.insert_object.request import add_scene_arguments, requests_of, scene_source_of, tree_of
from metric_cli.parser import OutputFile, new_folder

if TYPE_CHECKING:
    from insertion.insertion_scene import PreparedScene
    from insertion.request import ObjectRequest
    from insertion.result import InsertionResult
    from metric_tree.tree import Tree

PROGRAM = "insert-object"
#: What says where an object stands, which the page replaces.
PLACE_OPTIONS = ("--place", "--at", "--on", "--plane", "--xy", "--facing")

EPILOG = f"""\
Several objects: repeat --model; --size, --at, --on, --plane, --xy, --facing and --category belong to the --model before
them. The object's metres are divided by the scale, and nothing else.
{statuses_text(input_error=", or there is no level surface at the place")}"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run `insert-object`; the exit status is 0, 2 or 1."""
    from metric_cli.errors import INPUT_ERROR, exit_status

    words = list(sys.argv[1:] if argv is None else argv)
    if words[:1] == ["study"] and not Path("study").is_dir():
        sys.stderr.write("insert-object: the user study has moved to `python -m benchmarks.user_study` in a clone\n")
        return INPUT_ERROR
    return exit_status(PROGRAM, lambda: _run(parser().parse_args(words), words))


def parser() -> argparse.ArgumentParser:
    """The argument parser."""
    from metric_cli.parser import add_program_options, program_parser

    description = "Insert glTF models into the pictures of a reconstruction, or into its video, at their true size."
    root = program_parser(PROGRAM, description, EPILOG)
    add_scene_arguments(root)
    add = root.add_argument
    add("--out", metavar="OUT", type=OutputFile(), help="a video (OUT.mp4), or a new folder for one PNG a frame")
    add("--renderer", choices=("embedded", "blender"), default="embedded", help="Blender's Cycles, if it is installed")
    codecs = ("h264", "hevc", "prores", "lossless", "vp9")
    add("--codec", choices=codecs, help="of the video (default: h264, or hevc for a source of more than 8 bits)")
    add("--frames", metavar="FIRST:LAST", help="draw only these pictures, by number from 0, both included")
    add(
        "--layers",
        metavar="DIR",
        type=new_folder,
        help="object, shadow, matte, depth, normals, ids, plate of each picture",
    )
    add("--show-interval", action="store_true", help="draw the object's outline at both ends of the scale's interval")
    add(
        "--export",
        metavar="DIR",
        type=new_folder,
        help="the scene in metres: glTF, USD, Blender, COLMAP, nerfstudio, masks, depth",
    )
    add(
        "--preview",
        metavar="FILE",
        type=OutputFile(),
        help="draw the free places into a picture, best first, and list the options for each; needs no --out",
    )
    place = "open a page to drag and turn the object in the pictures; it says the command to repeat; needs no --out"
    add("--place", metavar="PORT", type=int, nargs="?", const=0, help=place)
    add("--json", action="store_true", help="print the result as JSON (metric-tree/insertion/1)")
    add_program_options(root)
    return root


def _run(options: argparse.Namespace, words: Sequence[str]) -> int:
    from insertion.insert import insert, open_scene
    from insertion.request import InsertionRequest, parse_frame_range
    from metric_cli.progress import progress_bars
    from metric_cli.tables import warn

    _check_outputs(options)
    requests = requests_of(options)
    source = scene_source_of(options)
    prepared = open_scene(source)
    tree = tree_of(options)
    if options.preview is not None:
        _preview(prepared, requests[0], tree, options)
    if options.place is not None:
        requests = [_place_on_page(prepared, requests[0], tree, options, words)]
    if options.out is None:
        return 0
    with progress_bars() as shown:
        request = InsertionRequest(
            scene=source,
            objects=tuple(requests),
            tree=tree,
            out=options.out,
            codec=options.codec,
            frames=None if options.frames is None else parse_frame_range(options.frames),
            renderer=options.renderer,
            show_interval=options.show_interval,
            layers=options.layers,
            export=options.export,
        )
        insertion = insert(request, prepared, shown)
    for line in (*insertion.warnings, *(line for result in insertion.objects for line in result.warnings)):
        warn(line, PROGRAM)
    _print(insertion.objects, options.json)
    return 0


def _check_outputs(options: argparse.Namespace) -> None:
    """InputError for what cannot be written or drawn: said before the work is done, not after."""
    from insertion.blender.run import blender_program
    from insertion.footage.image_writer import output_kind, preview_place
    from insertion.render.gpu import check_renderer

    alone = options.preview is not None or options.place is not None
    if options.out is None and (not alone or options.export is not None):
        raise InputError("--out: expected a video or a folder (or --preview FILE or --place alone); found none")
    if options.place is not None:
        if not 0 <= options.place < 1 << 16:
            raise InputError.at("--place", "port", "a number from 0 to 65535", options.place)
        if len(options.objects) > 1:
            raise InputError(f"--place: expected one --model; found {len(options.objects)}")
        check_renderer()
    if options.out is not None:
        output_kind(options.out)
        check_renderer()
    if options.preview is not None:
        preview_place(options.preview)
    if options.renderer == "blender":
        blender_program()


def _place_on_page(
    prepared: PreparedScene,
    request: ObjectRequest,
    tree: Tree | None,
    options: argparse.Namespace,
    words: Sequence[str],
) -> ObjectRequest:
    """The request with the place that a person has chosen on a page; what repeats it goes to standard output."""
    from insertion.placement_page import PlacePage

    page = PlacePage(
        prepared, request, tree, lambda asked: _command_again(asked, words, options.out is None), options.place
    )
    sys.stderr.write(f"{PROGRAM}: put the object into the picture: {page.url}\n")
    page.serve()
    assert page.chosen is not None  # the page ends with one
    if not options.json:
        sys.stdout.write(_command_again(page.chosen, words, options.out is None) + "\n")
    return page.chosen


def _command_again(request: ObjectRequest, words: Sequence[str], without_out: bool) -> str:
    """The command of these words with the place of a request."""
    import shlex

    kept, left = [], list(words)
    while left:
        name, equals, _ = left[0].partition("=")
        if name not in PLACE_OPTIONS:
            kept.append(left.pop(0))
            continue
        left.pop(0)
        has_value = name != "--place" or (bool(left) and left[0].isdecimal())
        if not equals and has_value and left:
            left.pop(0)
    assert request.at is not None
    at = f"frame={request.at.frame},x={request.at.x:.1f},y={request.at.y:.1f}"
    out = ["--out", "OUT.mp4"] if without_out else []
    return shlex.join([PROGRAM, *kept, "--at", at, "--facing", f"{float(request.facing):.0f}", *out])


def _preview(prepared: PreparedScene, request: ObjectRequest, tree: Tree | None, options: argparse.Namespace) -> None:
    """Draw and list the free places for the first object: on standard output if nothing else is asked for."""
    from dataclasses import asdict

    from insertion.placement.model_size import model_size
    from insertion.placement.placed_object import space_for
    from insertion.placement.preview import write_preview
    from metric_cli.tables import print_json
    from models3d.gltf.model_reader import read_model

    model = read_model(request.model)
    size = model_size(model, request.size, tree, request.category)
    places = write_preview(prepared, space_for(prepared, model, size), options.preview)
    if options.json and options.out is None:
        print_json({"schema": "metric-tree/places/1", "places": [asdict(place) for place in places]})
        return
    stream = sys.stdout if options.out is None else sys.stderr
    for place in places:
        where = "" if place.in_picture else "; not in the picture"
        stream.write(
            f"{place.number}: {place.options}   {max(0.0, place.above_m):.2f} m above the lowest plane{where}\n"
        )


def _print(results: Sequence[InsertionResult], as_json: bool) -> None:
    from metric_cli.tables import print_json

    if as_json:
        first, *more = (result.to_json() for result in results)
        print_json(first | ({"more": more} if more else {}))
        return
    for result in results:
        sys.stdout.write(_words(result) + "\n")


def _words(result: InsertionResult) -> str:
    scale = result.scale
    size = " x ".join(f"{value:.3g}" for value in result.size_m.values())
    line = f"{result.model}: {size} m (length, width, height) on {result.support}"
    line += f"; {scale.metres_per_unit:.4g} metres per unit"
    if scale.low is None or scale.high is None:
        line += ", stated without an interval"
    if scale.low is not None and scale.high is not None:
        low, high = scale.low / scale.metres_per_unit - 1, scale.high / scale.metres_per_unit - 1
        line += f"; the scale may be {low:+.0%} to {high:+.0%} off, and the object's height in the picture with it"
    shown = sum(frame.silhouette is not None for frame in result.frames)
    return f"{line}; in {shown} of {len(result.frames)} frames"
