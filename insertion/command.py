"""The `insert-object` command: arguments in, pictures and a result out; heavy imports wait until they are used."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from insertion.scene_arguments import add_scene_arguments, requests_of, stage_of, tree_of

if TYPE_CHECKING:
    from insertion.records.result import InsertionResult
    from insertion.staging.insert import Placed
    from insertion.staging.stage import Stage

__all__ = ["main", "parser"]

PROGRAM = "insert-object"

EPILOG = """\
Several objects: repeat --model; --size, --at, --on, --plane, --xy, --facing and --category belong to the --model before
them. The object's metres are divided by the scale, and nothing else. `insert-object study --help` makes the paper's
user study. Exit status: 0 done; 2 the input is at fault (one line says where), or there is no level surface at the
place; 1 a fault of the program.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run `insert-object`; the exit status is 0, 2 or 1."""
    from metric_base.terminal import exit_status

    words = list(sys.argv[1:] if argv is None else argv)
    if words[:1] == ["study"]:
        from insertion.study_command import run_study

        return exit_status(f"{PROGRAM} study", lambda: run_study(words[1:]))
    return exit_status(PROGRAM, lambda: _run(parser().parse_args(words)))


def parser() -> argparse.ArgumentParser:
    """The argument parser."""
    from metric_base.terminal import OneLineParser, version

    root = OneLineParser(
        prog=PROGRAM,
        description="Insert glTF models into the pictures of a reconstruction, or into its video, at their true size.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add_scene_arguments(root)
    add = root.add_argument
    add("--out", metavar="OUT", type=Path, required=True, help="a video (OUT.mp4), or a new folder for one PNG a frame")
    add("--renderer", choices=("embedded", "blender"), default="embedded", help="Blender's Cycles, if it is installed")
    add("--show-interval", action="store_true", help="draw the object's outline at both ends of the scale's interval")
    add(
        "--export",
        metavar="DIR",
        type=Path,
        help="the scene in metres: glTF, USD, Blender, COLMAP, nerfstudio, masks, depth",
    )
    add("--preview", metavar="FILE", type=Path, help="draw the free places into a picture, numbered, best first")
    add("--json", action="store_true", help="print the result as JSON (metric-tree/insertion/1)")
    add("--version", action="version", version=f"{PROGRAM} {version()}")
    return root


def _run(options: argparse.Namespace) -> int:
    from insertion.blender.process import blender_program
    from insertion.blender.tracing import export_blend, traced_layers
    from insertion.exports.write import LayerWriter, write_exports
    from insertion.outputs import output_kind, picture_writer, preview_place
    from insertion.scene.video_footage import VideoFootage
    from insertion.staging.insert import insert_objects, place_objects
    from metric_base.files import refuse_input

    output_kind(options.out)
    if options.preview is not None:
        preview_place(options.preview)
    if options.renderer == "blender":
        blender_program()  # said before the work is done, not after
    requests = requests_of(options)
    stage = stage_of(options)
    film = stage.footage if isinstance(stage.footage, VideoFootage) else None
    source, turned = (film.source, film.turned_deg) if film is not None else (None, 0)
    for option, path in (("--out", options.out), ("--preview", options.preview)):
        if path is not None:
            models = [item.model for item in requests]
            refuse_input(path, option, [source, options.scene, options.images, options.instances, *models])
    objects = place_objects(stage, requests, tree_of(options))
    if options.preview is not None:
        _write_preview(stage, objects[0], options.preview)
    with picture_writer(options.out, source, turned) as write, _exports(options.export) as folder:
        layers = None if folder is None else LayerWriter(folder, stage.footage.shots, stage.scale.metres_per_unit)
        results = insert_objects(
            stage,
            objects,
            write,
            show_interval=options.show_interval,
            film=film is not None,
            layers=layers,
            tracer=traced_layers if options.renderer == "blender" else None,
        )
        if folder is not None:
            for line in [*write_exports(folder, stage, objects, results), *export_blend(folder, stage, objects)]:
                sys.stderr.write(f"{PROGRAM}: warning: {line}\n")
    for result in results:
        for line in result.warnings:
            sys.stderr.write(f"{PROGRAM}: warning: {line}\n")
    _print(results, options.json)
    return 0


@contextmanager
def _exports(folder: Path | None) -> Iterator[Path | None]:
    """The folder to export into, which appears whole; None where nothing is to be exported."""
    if folder is None:
        yield None
        return
    from metric_base.files import whole_folder

    with whole_folder(folder, "--export") as temporary:
        yield temporary


def _write_preview(stage: Stage, placed: Placed, file: Path) -> None:
    from insertion.places.locate import candidates
    from insertion.staging.insert import space_for
    from insertion.staging.preview import write_preview

    write_preview(stage, candidates(space_for(stage, placed.model, placed.size)), placed, file)


def _print(results: Sequence[InsertionResult], as_json: bool) -> None:
    from metric_base.terminal import print_json

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
    if scale.low is not None and scale.high is not None:
        low, high = scale.low / scale.metres_per_unit - 1, scale.high / scale.metres_per_unit - 1
        line += f"; the scale may be {low:+.0%} to {high:+.0%} off, and the object's height in the picture with it"
    shown = sum(frame.silhouette is not None for frame in result.frames)
    return f"{line}; in {shown} of {len(result.frames)} frames"
