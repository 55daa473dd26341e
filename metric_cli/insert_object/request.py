"""The arguments that `insert-object` and `insert-object study` share, and what they ask for."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from metric_base.errors import InputError
from metric_cli.parser import input_path

if TYPE_CHECKING:
    from estimator.records.objects import Up
    from insertion.insertion_scene import PreparedScene
    from insertion.request import ObjectRequest, SceneSource

#: Metres beyond which no plane of a scene reaches.
FARTHEST_M = 1e6
#: Seconds of the longest animation; metres a second of what moves over a floor.
LONGEST_S, SLOWEST_M_S, FASTEST_M_S = 1e6, 1e-3, 1e3


class _PerModel(argparse.Action):
    """A value that belongs to the last --model."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        """Store the value in the last object of `namespace.objects`."""
        objects: list[dict[str, Any]] = namespace.objects or []
        if self.dest == "model":
            objects = [*objects, {"model": values}]
        elif not objects:
            parser.error(f"{option_string}: expected --model before it")
        else:
            objects[-1][self.dest] = values
        namespace.objects = objects


def add_scene_arguments(root: argparse.ArgumentParser) -> None:
    """What `insert-object` and `insert-object study` share."""
    add = root.add_argument
    add("scene", metavar="SCENE|WORK", type=input_path, help="COLMAP model folder with its pictures, or a work folder")
    add("--images", metavar="DIR", type=input_path, help="the pictures (default: `images` beside or above the model)")
    add(
        "--instances",
        metavar="FILE",
        type=input_path,
        help="masks that hide the object (default: SCENE/instances.json)",
    )
    add("--moving", metavar="FILE", type=input_path, help="masks of people and objects that move, of every frame")
    add("--dense", metavar="FILE|none", help="dense cloud (default: the one beside the model, if any)")
    add("--scale", metavar="METRES|FILE", help="metres per scene unit, or a result's file (default: SCENE/result.json)")
    add("--up", metavar="X,Y,Z", help="up in the scene's axes, if it is known (default: by the cameras and planes)")
    add("--tree", metavar="REF", help="release for --size prior and --on (default: the newest available)")
    each = root.add_argument_group("each object")
    add_one = each.add_argument
    add_one(
        "--model", metavar="FILE", type=input_path, action=_PerModel, required=True, help="glTF or GLB file, in metres"
    )
    add_one("--size", action=_PerModel, help="file (default), height=METRES (length=, width=), or prior")
    add_one("--category", metavar="NAME", action=_PerModel, help="category of the tree, for --size prior")
    add_one("--at", metavar="WHERE", action=_PerModel, help="frame=NAME_OR_INDEX,x=PX,y=PX or auto (default)")
    add_one("--on", metavar="CATEGORY", action=_PerModel, help="free space on top of an object of this category")
    add_one("--plane", metavar="N", type=int, action=_PerModel, help="a support plane, lowest first from 0")
    add_one("--xy", metavar="X,Y", action=_PerModel, help="metres along the plane's axes from its middle (default 0,0)")
    add_one("--facing", action=_PerModel, help="camera (default), wall, or degrees turned from the camera")
    add_one("--clip", metavar="NAME", action=_PerModel, help="animation of the file (default: the first), or none")
    add_one("--at-time", metavar="SECONDS", type=float, action=_PerModel, help="the pose of this time, standing still")
    path = "points that it follows: pixels of the picture of --at, or metres with --plane"
    add_one("--path", metavar='"X,Y X,Y ..."', action=_PerModel, help=path)
    add_one("--speed", metavar="M_PER_S", type=float, action=_PerModel, help="on the path (default: the whole video)")
    root.set_defaults(objects=None)


def requests_of(options: argparse.Namespace) -> list[ObjectRequest]:
    """The objects that the arguments ask for."""
    return [_request(stated) for stated in options.objects]


def prepared_scene_of(options: argparse.Namespace) -> PreparedScene:
    """The scene of the arguments, ready for insertion."""
    from insertion.insert import open_scene

    return open_scene(scene_source_of(options))


def scene_source_of(options: argparse.Namespace) -> SceneSource:
    """The files and the scale of the scene."""
    from insertion.request import SceneSource
    from insertion.scene.scale import read_scale

    return SceneSource(
        folder=options.scene,
        scale=read_scale(options.scene, _scale(options.scale)),
        images=options.images,
        instances=options.instances,
        moving=options.moving,
        dense=options.dense,
        up=_up(options.up),
    )


def tree_of(options: argparse.Namespace) -> Any:
    """The release for `--size prior` and `--on`; None where no object needs one."""
    if not any(stated.get("size") == "prior" or stated.get("on") is not None for stated in options.objects):
        return None
    import metric_tree

    return metric_tree.open(options.tree)


def _request(stated: dict[str, Any]) -> ObjectRequest:
    from insertion.request import ObjectRequest, parse_facing, parse_path, parse_pixel_position

    ways = [name for name in ("at", "on", "plane") if stated.get(name) is not None]
    if len(ways) > 1:
        raise InputError(f"--{ways[0]}: expected one of --at, --on and --plane; found also --{ways[1]}")
    return ObjectRequest(
        stated["model"],
        stated.get("size") or "file",
        parse_pixel_position(stated.get("at") or "auto"),
        stated.get("on"),
        stated.get("plane"),
        _xy(stated.get("xy") or "0,0"),
        parse_facing(stated.get("facing") or "camera"),
        stated.get("category"),
        stated.get("clip"),
        _number(stated, "at_time", 0.0, LONGEST_S),
        () if stated.get("path") is None else parse_path(stated["path"]),
        _number(stated, "speed", SLOWEST_M_S, FASTEST_M_S),
    )


def _number(stated: dict[str, Any], name: str, low: float, high: float) -> float | None:
    value = stated.get(name)
    if value is not None and not low <= value <= high:
        option = name.replace("_", "-")
        raise InputError(f"--{option}: expected a number from {low:g} to {high:g}; found {value:g}")
    return None if value is None else float(value)


def _scale(words: str | None) -> float | Path | None:
    """The number or the file that `--scale` names."""
    try:
        return None if words is None else float(words)
    except ValueError:
        if not Path(words or "").is_file():
            raise InputError(f"--scale: expected metres per unit, or a result's file; found {words!r}") from None
        return Path(words or "")


def _up(words: str | None) -> Up | None:
    from estimator.geometry.vertical import up_from_vector

    try:
        return None if words is None else up_from_vector(tuple(float(part) for part in words.split(",")))
    except (ValueError, TypeError):
        raise InputError.at("--up", "direction", "X,Y,Z, three finite numbers, not all 0", words) from None


def _xy(words: str) -> tuple[float, float]:
    try:
        x, y = (float(word) for word in words.split(","))
    except ValueError:
        x = y = math.nan
    if not max(abs(x), abs(y)) < FARTHEST_M:
        raise InputError(f"--xy: expected X,Y in metres; found {words!r}")
    return x, y
