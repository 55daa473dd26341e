"""The `insert-object` command: parse, build one request, run, print. Heavy modules are imported when they are used."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from metric_base.errors import InputError
from metric_base.parsing import stated_numbers
from metric_cli.batch import BatchCommand, batch_run, check_batch_options
from metric_cli.errors import INPUT_ERROR, exit_status
from metric_cli.insert_object.parser import POSITION_OPTIONS, PROGRAM, parser
from metric_cli.parser import parse_up, same_named

if TYPE_CHECKING:
    from insertion.insertion_scene import InsertionScene
    from insertion.request import InsertionRequest, ObjectRequest, SceneSource
    from insertion.result import InsertionResult
    from metric_tree.tree import Tree

#: Maximum distance of `--xy` in metres: no plane of a scene is larger.
MAX_XY_M = 1e6
#: Range of `--at-time` and `--path-start` in seconds.
TIME_RANGE_S = (0.0, 1e6)
#: Range of `--speed` in metres per second.
SPEED_RANGE_M_S = (1e-3, 1e3)
#: Maximum port number of TCP.
MAX_PORT = 65_535


def batch_columns(text: str) -> dict[str, Any]:
    """Return the columns of a batch for a result of `metric-tree/insertion/1`."""
    scale = json.loads(text)["scale"]
    return {"status": "inserted", "scale": scale["metres_per_unit"], "low": scale["low"], "high": scale["high"]}


BATCH = BatchCommand(PROGRAM, __name__, (), parser, batch_columns)


def main(argv: Sequence[str] | None = None) -> int:
    """Run `insert-object`; the exit status is 0, 2 or 1."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] == ["study"] and not Path("study").is_dir():
        sys.stderr.write("insert-object: the user study has moved to `python -m benchmarks.user_study` in a clone\n")
        return INPUT_ERROR
    return exit_status(PROGRAM, batch_run(BATCH, arguments) or (lambda: run(*parse_request(arguments), arguments)))


def parse_request(argv: Sequence[str]) -> tuple[argparse.Namespace, InsertionRequest]:
    """Parse and check the arguments; return them with the request that they make.

    Raises
    ------
    InputError
        An argument is invalid, an output cannot be written, or the renderer is not available.
    """
    from insertion.request import InsertionRequest, parse_frame_range

    options = parser().parse_args(list(argv))
    check_batch_options(options)
    # Raise InputError if an output cannot be written or drawn; this precedes all work.
    from insertion.blender.run import blender_program
    from insertion.footage.image_writer import check_preview_path, output_kind
    from insertion.render.gpu import check_renderer

    is_only_placed = options.preview is not None or options.place is not None
    if options.out is None and (not is_only_placed or options.export is not None):
        raise InputError("--out: expected a video or a folder (or only --preview FILE or --place); found none")
    if options.place is not None:
        if not 0 <= options.place <= MAX_PORT:
            raise InputError.at("--place", "port", f"a number from 0 to {MAX_PORT}", options.place)
        check_renderer()
    if options.out is not None:
        output_kind(options.out)
        check_renderer()
    if options.preview is not None:
        check_preview_path(options.preview)
    if options.renderer == "blender":
        blender_program()
    objects = parse_objects(options.objects)
    computed = {
        "scene": parse_scene(options),
        "objects": tuple(objects),
        "tree": tree_for(objects, options.tree),
        "frames": None if options.frames is None else parse_frame_range(options.frames),
    }
    return options, InsertionRequest(**same_named(options, InsertionRequest) | computed)


def parse_scene(options: argparse.Namespace) -> SceneSource:
    """Return the files and the scale of the scene. Raises InputError for an invalid value or result file."""
    from estimator.geometry.vertical import up_from_vector
    from insertion.request import SceneSource
    from insertion.scene.scale import read_scale

    scale: float | Path | None = None
    if options.scale is not None:
        try:
            scale = float(options.scale)
        except ValueError:
            scale = Path(options.scale)
            if not scale.is_file():
                found = f"found {options.scale!r}"
                raise InputError(f"--scale: expected metres per unit, or a result file; {found}") from None
    up = None if options.up is None else up_from_vector(parse_up(options.up))
    computed = {"folder": options.scene, "scale": read_scale(options.scene, scale), "up": up}
    return SceneSource(**same_named(options, SceneSource) | computed)


def parse_objects(groups: Sequence[argparse.Namespace]) -> list[ObjectRequest]:
    """Return the requested objects, one for each --model. Raises InputError for an invalid value."""
    from insertion.request import ObjectRequest, parse_facing, parse_path, parse_pixel_position

    objects = []
    for group in groups:
        positions = [name for name in ("at", "on", "plane") if getattr(group, name) is not None]
        if len(positions) > 1:
            raise InputError(f"--{positions[0]}: expected one of --at, --on and --plane; found also --{positions[1]}")
        for name, (low, high) in (("at_time", TIME_RANGE_S), ("path_start", TIME_RANGE_S), ("speed", SPEED_RANGE_M_S)):
            value = getattr(group, name)
            if value is not None and not low <= value <= high:
                option = name.replace("_", "-")
                raise InputError(f"--{option}: expected a number from {low:g} to {high:g}; found {value:g}")
        xy_m = stated_numbers(group.xy or "0,0")
        if len(xy_m) != 2 or max(map(abs, xy_m)) >= MAX_XY_M:
            raise InputError(f"--xy: expected X,Y in metres; found {group.xy!r}")
        computed = {
            "size": group.size or "file",
            "at": parse_pixel_position(group.at or "auto"),
            "xy_m": xy_m,
            "facing": parse_facing(group.facing or "camera"),
            "at_time_s": group.at_time,
            "path": () if group.path is None else parse_path(group.path),
            "speed_m_s": group.speed,
            "path_start_s": group.path_start or 0.0,
        }
        objects.append(ObjectRequest(**same_named(group, ObjectRequest) | computed))
    return objects


def tree_for(objects: Sequence[ObjectRequest], reference: str | None) -> Tree | None:
    """Open the release if an object needs a prior size or a position on a category; otherwise return None."""
    if not any(request.size == "prior" or request.on is not None for request in objects):
        return None
    import metric_tree

    return metric_tree.open(reference)


def run(options: argparse.Namespace, request: InsertionRequest, argv: Sequence[str]) -> int:
    """Write the preview, serve the placement page and insert the objects, as far as the command requests it."""
    from insertion.insert import insert
    from insertion.insertion_scene import open_scene
    from metric_cli.progress import progress_bars
    from metric_cli.tables import warn

    scene = open_scene(request.scene)
    if options.preview is not None:
        _write_preview(options, request, scene)
    if options.place is not None:
        # Objects with the positions that the user chooses on the page; print the equivalent command.
        from insertion.placement_page import PlacementPage

        has_out = request.out is not None
        equivalent = partial(command_line, argv=argv, has_out=has_out)
        page = PlacementPage(scene, request.objects, request.tree, equivalent, options.place)
        sys.stderr.write(f"{PROGRAM}: place the object on this page: {page.url}\n")
        page.serve()
        assert page.chosen is not None  # `serve` returns when the user has chosen a position
        if not options.json:
            sys.stdout.write(command_line(page.chosen, argv, has_out) + "\n")
        request = replace(request, objects=page.chosen)
    if request.out is None:
        return 0
    with progress_bars() as progress:
        insertion = insert(request, scene, progress)
    for line in (*insertion.warnings, *(line for result in insertion.objects for line in result.warnings)):
        warn(line, PROGRAM)
    _print(insertion.objects, options.json)
    return 0


def _write_preview(options: argparse.Namespace, request: InsertionRequest, scene: InsertionScene) -> None:
    """Draw and list the free positions of the first object; the list is on standard output if nothing else is."""
    from insertion.placement.model_size import model_size
    from insertion.placement.placed_object import footprint
    from insertion.placement.preview import write_preview
    from metric_cli.tables import print_json
    from models3d.gltf.model_reader import read_model

    placed = request.objects[0]
    model = read_model(placed.model)
    size = model_size(model, placed.size, request.tree, placed.category)
    radius, height = footprint(model, size, scene.scale.metres_per_unit)
    positions = write_preview(scene.space, scene.images, radius, height, options.preview)
    is_only_output = request.out is None
    if options.json and is_only_output:
        print_json({"schema": "metric-tree/places/1", "places": [asdict(position) for position in positions]})
        return
    stream = sys.stdout if is_only_output else sys.stderr
    for position in positions:
        note = "" if position.in_image else "; not in the image"
        height_m = max(0.0, position.above_m)
        stream.write(f"{position.number}: {position.options}   {height_m:.2f} m above the lowest plane{note}\n")


def command_line(requests: Sequence[ObjectRequest], argv: Sequence[str], has_out: bool) -> str:
    """Return the command with these arguments, except that positions in a frame are those of the requests."""
    kept, remaining, number = [], list(argv), -1
    while remaining:
        argument = remaining.pop(0)
        name, equals, _ = argument.partition("=")
        number += name == "--model"
        at = requests[number].at
        if name not in POSITION_OPTIONS or (at is None and name != "--place"):
            kept.append(argument)
            if name == "--model" and at is not None:
                facing = requests[number].facing
                kept += [] if equals else [remaining.pop(0)]
                kept += ["--at", f"frame={at.frame},x={at.x:.1f},y={at.y:.1f}"]
                kept += ["--facing", facing if isinstance(facing, str) else f"{facing:.0f}"]
            continue
        has_value = name != "--place" or (bool(remaining) and remaining[0].isdecimal())
        if not equals and has_value and remaining:
            remaining.pop(0)
    return shlex.join([PROGRAM, *kept, *([] if has_out else ["--out", "OUT.mp4"])])


def _print(results: Sequence[InsertionResult], as_json: bool) -> None:
    from metric_cli.tables import print_json

    if as_json:
        first, *others = (result.to_json() for result in results)
        print_json(first | ({"more": others} if others else {}))
        return
    for result in results:
        scale = result.scale
        size = " x ".join(f"{value:.3g}" for value in result.size_m.values())
        line = f"{result.model}: {size} m (length, width, height) on {result.support}"
        line += f"; {scale.metres_per_unit:.4g} metres per unit"
        if scale.low is None or scale.high is None:
            line += ", stated without an interval"
        else:
            low, high = scale.low / scale.metres_per_unit - 1, scale.high / scale.metres_per_unit - 1
            line += f"; the error of the scale, and of the height in the image, is {low:+.0%} to {high:+.0%}"
        n_visible = sum(frame.silhouette is not None for frame in result.frames)
        sys.stdout.write(f"{line}; in {n_visible} of {len(result.frames)} frames\n")
