"""The `insert-object` command: parse, build one request, run, print. Heavy modules are imported when they are used."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from metric_cli.batch import BatchCommand, batch_run
from metric_cli.errors import INPUT_ERROR, exit_status
from metric_cli.insert_object.parser import POSITION_OPTIONS, PROGRAM, parser
from metric_cli.insert_object.request import InsertCommand, parse_request

if TYPE_CHECKING:
    from insertion.insertion_scene import InsertionScene
    from insertion.request import ObjectRequest
    from insertion.result import InsertionResult


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
    return exit_status(PROGRAM, batch_run(BATCH, arguments) or (lambda: run(parse_request(arguments))))


def run(command: InsertCommand) -> int:
    """Write the preview, serve the placement page and insert the objects, as far as the command requests it."""
    from insertion.insert import insert
    from insertion.insertion_scene import open_scene
    from metric_cli.progress import progress_bars
    from metric_cli.tables import warn

    request = command.request
    scene = open_scene(request.scene)
    if command.preview is not None:
        _write_preview(command, scene)
    if command.place_port is not None:
        # Object with the position that the user chooses on the page; print the equivalent command.
        from insertion.placement_page import PlacementPage

        has_out = command.request.out is not None
        page = PlacementPage(
            scene,
            command.request.objects[0],
            command.request.tree,
            lambda request: command_line(request, command.argv, has_out),
            command.place_port,
        )
        sys.stderr.write(f"{PROGRAM}: place the object on this page: {page.url}\n")
        page.serve()
        assert page.chosen is not None  # `serve` returns when the user has chosen a position
        if not command.as_json:
            sys.stdout.write(command_line(page.chosen, command.argv, has_out) + "\n")
        request = replace(request, objects=(page.chosen,))
    if request.out is None:
        return 0
    with progress_bars() as progress:
        insertion = insert(request, scene, progress)
    for line in (*insertion.warnings, *(line for result in insertion.objects for line in result.warnings)):
        warn(line, PROGRAM)
    _print(insertion.objects, command.as_json)
    return 0


def _write_preview(command: InsertCommand, scene: InsertionScene) -> None:
    """Draw and list the free positions of the first object; the list is on standard output if nothing else is."""
    from insertion.placement.model_size import model_size
    from insertion.placement.placed_object import footprint
    from insertion.placement.preview import write_preview
    from metric_cli.tables import print_json
    from models3d.gltf.model_reader import read_model

    assert command.preview is not None
    request = command.request.objects[0]
    model = read_model(request.model)
    size = model_size(model, request.size, command.request.tree, request.category)
    radius, height = footprint(model, size, scene.scale.metres_per_unit)
    positions = write_preview(scene.space, scene.images, radius, height, command.preview)
    is_only_output = command.request.out is None
    if command.as_json and is_only_output:
        print_json({"schema": "metric-tree/places/1", "places": [asdict(position) for position in positions]})
        return
    stream = sys.stdout if is_only_output else sys.stderr
    for position in positions:
        note = "" if position.in_picture else "; not in the image"
        height_m = max(0.0, position.above_m)
        stream.write(f"{position.number}: {position.options}   {height_m:.2f} m above the lowest plane{note}\n")


def command_line(request: ObjectRequest, argv: Sequence[str], has_out: bool) -> str:
    """Return the command with these arguments, except that the position is that of the request."""
    kept, remaining = [], list(argv)
    while remaining:
        argument = remaining.pop(0)
        name, equals, _ = argument.partition("=")
        if name not in POSITION_OPTIONS:
            kept.append(argument)
            continue
        has_value = name != "--place" or (bool(remaining) and remaining[0].isdecimal())
        if not equals and has_value and remaining:
            remaining.pop(0)
    assert request.at is not None
    at = f"frame={request.at.frame},x={request.at.x:.1f},y={request.at.y:.1f}"
    out = [] if has_out else ["--out", "OUT.mp4"]
    return shlex.join([PROGRAM, *kept, "--at", at, "--facing", f"{float(request.facing):.0f}", *out])


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
