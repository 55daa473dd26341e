"""Parse the arguments of `insert-object` into a validated request."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from metric_base.errors import InputError
from metric_cli.batch import check_batch_options
from metric_cli.insert_object.parser import parser
from metric_cli.parser import same_named

if TYPE_CHECKING:
    from insertion.request import InsertionRequest, ObjectRequest, SceneSource
    from metric_tree.tree import Tree

#: Maximum distance of `--xy` in metres: no plane of a scene is larger.
MAX_XY_M = 1e6
#: Range of `--at-time` and `--path-start` in seconds.
TIME_RANGE_S = (0.0, 1e6)
#: Range of `--speed` in metres per second.
SPEED_RANGE_M_S = (1e-3, 1e3)
#: Maximum port number of TCP.
MAX_PORT = 65_535


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertCommand:
    """One run of `insert-object`."""

    request: InsertionRequest
    preview: Path | None  #: image of the free positions
    place_port: int | None  #: port of the placement page, 0 for any free port; None for no page
    as_json: bool
    argv: tuple[str, ...]  #: arguments, which the placement page shows with the new position


def parse_request(argv: Sequence[str]) -> InsertCommand:
    """Parse and check the arguments.

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
        if len(options.objects) > 1:
            raise InputError(f"--place: expected one --model; found {len(options.objects)}")
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
    return InsertCommand(
        request=InsertionRequest(**same_named(options, InsertionRequest) | computed),
        preview=options.preview,
        place_port=options.place,
        as_json=options.json,
        argv=tuple(argv),
    )


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
    try:
        up = None if options.up is None else up_from_vector(tuple(float(part) for part in options.up.split(",")))
    except (ValueError, TypeError):
        raise InputError.at("--up", "direction", "X,Y,Z, three finite numbers, not all 0", options.up) from None
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
        try:
            x_m, y_m = (float(part) for part in (group.xy or "0,0").split(","))
        except ValueError:
            x_m = y_m = math.nan
        if not max(abs(x_m), abs(y_m)) < MAX_XY_M:
            raise InputError(f"--xy: expected X,Y in metres; found {group.xy!r}")
        computed = {
            "size": group.size or "file",
            "at": parse_pixel_position(group.at or "auto"),
            "xy_m": (x_m, y_m),
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
