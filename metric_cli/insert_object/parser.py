"""The command-line options of `insert-object`."""

from __future__ import annotations

import argparse
from typing import Any

from metric_cli.batch import add_batch
from metric_cli.errors import exit_status_help
from metric_cli.parser import OneLineParser, OutputFile, add_program_options, input_path, new_folder, program_parser

PROGRAM = "insert-object"
#: Options that give the position of an object, which the placement page replaces.
POSITION_OPTIONS = ("--place", "--at", "--on", "--plane", "--xy", "--facing")
CODECS = ("h264", "hevc", "prores", "lossless", "vp9")

EPILOG = f"""\
For several objects, repeat --model: the options of an object belong to the --model before them. The size of an object
in metres is divided by the scale; it is not adjusted otherwise.
{exit_status_help(input_error=", or there is no level surface at the position")}"""


class _PerModel(argparse.Action):
    """Store a value in the record of the last --model."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        """Append a record to `namespace.objects` for --model, otherwise set a field of the last record."""
        objects: list[argparse.Namespace] = namespace.objects or []
        if self.dest == "model":
            fields = {action.dest: None for action in parser._actions if isinstance(action, _PerModel)}
            objects = [*objects, argparse.Namespace(**fields)]
        elif not objects:
            parser.error(f"{option_string}: expected --model before it")
        setattr(objects[-1], self.dest, values)
        namespace.objects = objects


def parser() -> OneLineParser:
    """Return the argument parser; `docs/reference/commands.md` shows its help."""
    root = program_parser(
        PROGRAM,
        "Insert glTF models at their true size into the images or the video of a reconstruction.",
        EPILOG,
        usage=f"{PROGRAM} SCENE|WORK --model FILE [OPTION ...] --out OUT",
    )
    add_scene(root)
    add_objects(root)
    # fmt: off
    add = root.add_argument_group("output").add_argument
    add("--out", metavar="OUT", type=OutputFile(),
        help="video (OUT.mp4), or new folder with one PNG file per frame; with --batch: RESULTS.parquet")
    add("--json", action="store_true", help="print the result as JSON (metric-tree/insertion/1)")
    add("--frames", metavar="FIRST:LAST", help="write only these frames, by index from 0, both included")
    add("--codec", choices=CODECS, help="codec of the video (default: h264, or hevc for a source above 8 bits)")
    add("--renderer", choices=("embedded", "blender"), default="embedded",
        help="blender: Cycles, if Blender is installed (default: %(default)s)")
    add("--show-interval", action="store_true", help="draw outlines at both ends of the scale interval")
    add("--layers", metavar="DIR", type=new_folder,
        help="OpenEXR layers of each frame: object, shadow, matte, depth, normals, ids, plate")
    add("--export", metavar="DIR", type=new_folder,
        help="the scene in metres: glTF, USD, Blender, COLMAP, nerfstudio, masks, depth")

    add = root.add_argument_group("choosing a position (--out is optional)").add_argument
    add("--preview", metavar="FILE", type=OutputFile(),
        help="draw the free positions into an image, best first, and list the options for each")
    add("--place", metavar="PORT", type=int, nargs="?", const=0,
        help="place the object on a local web page, which shows the equivalent command")
    # fmt: on
    add_batch(root, with_out=False)
    add_program_options(root)
    return root


def add_scene(root: argparse.ArgumentParser) -> None:
    """Add the options of a scene."""
    root.add_argument(
        "scene", metavar="SCENE|WORK", type=input_path, help="COLMAP model folder with its images, or a work folder"
    )
    add = root.add_argument_group("scene").add_argument
    # fmt: off
    add("--scale", metavar="METRES|FILE", help="metres per scene unit, or a result file (default: SCENE/result.json)")
    add("--images", metavar="DIR", type=input_path,
        help="folder of the images (default: `images` next to or above the model)")
    add("--instances", metavar="FILE", type=input_path,
        help="masks of possible occluders (default: SCENE/instances.json, or those drawn in SCENE.metric-tree)")
    add("--moving", metavar="FILE", type=input_path, help="masks of moving people and objects in every frame")
    add("--dense", metavar="FILE|none", help="dense cloud (default: the file next to the model, if any)")
    add("--up", metavar="X,Y,Z", help="up direction in scene axes (default: from cameras and planes)")
    add("--tree", metavar="REF", help="release for --size prior and --on (default: the newest available)")
    # fmt: on


def add_objects(root: argparse.ArgumentParser) -> None:
    """Add the options of the objects, which `_PerModel` collects in `objects`."""
    add = root.add_argument_group("each object").add_argument
    # fmt: off
    add("--model", metavar="FILE", type=input_path, action=_PerModel, required=True,
        help="glTF or GLB file, in metres")
    add("--size", action=_PerModel, help="file (default), height=METRES (length=, width=), or prior")
    add("--category", metavar="NAME", action=_PerModel, help="category of the tree, for --size prior")
    add("--at", metavar="WHERE", action=_PerModel,
        help="pixel of a frame, frame=NAME_OR_INDEX,x=PX,y=PX, or auto (default)")
    add("--on", metavar="CATEGORY", action=_PerModel, help="free space on top of an object of this category")
    add("--plane", metavar="N", type=int, action=_PerModel, help="index of a support plane, lowest first from 0")
    add("--xy", metavar="X,Y", action=_PerModel,
        help="metres along the axes of the plane from its centre (default 0,0)")
    add("--facing", action=_PerModel, help="camera (default), wall, or degrees from the direction to the camera")
    add("--clip", metavar="NAME", action=_PerModel, help="animation of the file (default: the first), or none")
    add("--at-time", metavar="SECONDS", type=float, action=_PerModel, help="freeze the animation at this time")
    add("--path", metavar='"X,Y X,Y ..."', action=_PerModel,
        help="path of the object: pixels in the frame of --at, or metres with --plane")
    add("--speed", metavar="M_PER_S", type=float, action=_PerModel,
        help="speed on the path (default: the path takes the rest of the video)")
    add("--path-start", metavar="SECONDS", type=float, action=_PerModel,
        help="time in the video at which the object starts on its path (default: 0)")
    # fmt: on
    root.set_defaults(objects=None)
