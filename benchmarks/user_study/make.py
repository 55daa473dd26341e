"""Command `python -m benchmarks.user_study`: write the page of the study, or evaluate its responses."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from metric_base.errors import InputError
from metric_cli.errors import exit_status
from metric_cli.parser import OneLineParser, OutputFile, add_overwrite, input_path

PROGRAM = "python -m benchmarks.user_study"
#: Maximum number of times that each size is shown.
MAX_REPEATS = 10


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return the exit status: 0, 1 (internal error) or 2 (invalid input)."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] == ["report"]:
        return exit_status(PROGRAM, lambda: _report(report_parser().parse_args(arguments[1:])))
    return exit_status(PROGRAM, lambda: _make(page_parser().parse_args(arguments)))


def page_parser() -> argparse.ArgumentParser:
    """Return the parser of the command that writes the page."""
    from metric_cli.insert_object.parser import add_objects, add_scene

    root = OneLineParser(
        prog=PROGRAM,
        description="Write a page that works offline and shows one insertion at the paper's eleven sizes.",
        allow_abbrev=False,
    )
    add_scene(root)
    add_objects(root)
    root.add_argument(
        "--frame",
        metavar="NAME",
        help="frame to show (default: the one in which the object is tallest and fully in view)",
    )
    root.add_argument("--object", default="object", help="name of the object on the page")
    root.add_argument("--thing", dest="object", default=argparse.SUPPRESS, help=argparse.SUPPRESS)  # the former name
    root.add_argument("--title", default="How large does it look?", help="heading of the page")
    root.add_argument(
        "--repeats", type=int, default=2, help="number of times that each size is shown (default: %(default)s)"
    )
    root.add_argument("--out", metavar="FILE", type=OutputFile(), required=True, help="path of the page, FILE.html")
    add_overwrite(root)
    return root


def report_parser() -> argparse.ArgumentParser:
    """Return the parser of the command that evaluates the responses."""
    root = OneLineParser(prog=f"{PROGRAM} report", description="Print the curve of the answers.", allow_abbrev=False)
    root.add_argument(
        "answers", metavar="ANSWERS", type=input_path, help="file that the page saved, or a folder with such files"
    )
    root.add_argument("--figure", metavar="FILE", type=OutputFile(), help="draw the curve (.png, .svg, .pdf)")
    root.add_argument("--json", action="store_true", help="print the curve as JSON")
    add_overwrite(root)
    return root


def _make(options: argparse.Namespace) -> int:
    from benchmarks.user_study.page import plan_text, study_page
    from insertion.insertion_scene import open_scene
    from insertion.placement.placed_object import place_objects
    from metric_base.files import output_file, whole_file
    from metric_cli.insert_object.insert import parse_objects, parse_scene, tree_for

    output_file(options.out)
    if not 1 <= options.repeats <= MAX_REPEATS:
        raise InputError(f"--repeats: expected 1 to {MAX_REPEATS}; found {options.repeats}")
    requests = parse_objects(options.objects)
    prepared = open_scene(parse_scene(options))
    placed = place_objects(requests, prepared.space, prepared.footage.frames, tree_for(requests, options.tree))
    images = _images(prepared, placed, options.frame)
    with whole_file(options.out, "--out") as file:
        file.write_text(study_page(images, options.title, options.object, options.repeats), encoding="utf-8")
    sys.stdout.write(f"{options.out}: {len(images)} sizes, each shown {options.repeats} times\n")
    sys.stdout.write(plan_text(options.repeats) + "\n")
    return 0


def _images(prepared: Any, placed: Sequence[Any], frame: str | None) -> dict[int, NDArray[np.uint8]]:
    """Return the image (h, w, 3) of a frame by step, with the first object scaled about the centre of its base."""
    from benchmarks.user_study.page import STEPS
    from insertion.composite.compositor import Compositor
    from metric_cli.progress import track

    chosen = _shot(prepared, placed, frame)
    image = next(image for shown, image in prepared.footage if shown.index == chosen.index)
    light, content, start_s = prepared.light, prepared.content, prepared.footage.start_s
    drawn = {}
    for step in track(STEPS, "drawing the sizes", len(STEPS)):
        objects = [_resized(placed[0], 1 + step / 100), *placed[1:]]
        with closing(Compositor(objects, light, content, start_s)) as compositor:
            drawn[step] = compositor.draw(chosen, image)
    return drawn


def _resized(placed: Any, factor: float) -> Any:
    """Return an object scaled about its foot."""
    size = replace(placed.size, factor=placed.size.factor * factor)
    return replace(placed, size=size, body=replace(placed.body, unit=placed.body.unit * factor))


def _shot(prepared: Any, placed: Sequence[Any], frame: str | None) -> Any:
    """Return the named frame, or the frame in which the object is tallest and fully in view."""
    from estimator.projection.cameras import pixels_in_view

    frames = [shot for shot in prepared.footage.frames if shot.view is not None]
    if frame is not None:
        named = [shot for shot in frames if frame in (shot.name, Path(shot.name).stem, str(shot.index))]
        if not named:
            raise InputError(f"--frame: expected the name or number of a frame with a known pose; found {frame!r}")
        return named[0]
    body = placed[0].body
    corners = body.position + body.unit * 1.3 * body.corners[:: max(1, len(body.corners) // 500)]

    def height(shot: Any) -> float:
        pixels, _ = pixels_in_view(shot.view, corners)
        return float(np.ptp(pixels[:, 1])) if np.isfinite(pixels).all() else 0.0

    return max(frames, key=height)


def _report(options: argparse.Namespace) -> int:
    from benchmarks.user_study.answers import read_answers
    from benchmarks.user_study.curve import curve_of
    from benchmarks.user_study.report import report_text, write_curve
    from metric_base.files import output_file
    from metric_cli.tables import print_json

    if options.figure is not None:
        output_file(options.figure, "--figure")
    warnings: list[str] = []
    curve = curve_of(read_answers(options.answers, warnings))
    for line in warnings:
        sys.stderr.write(f"{PROGRAM} report: warning: {line}\n")
    if options.figure is not None:
        write_curve(curve, options.figure)
    if options.json:
        print_json(_record(curve))
    else:
        sys.stdout.write(report_text(curve) + "\n")
    return 0


def _record(curve: Any) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "schema": "metric-tree/study-report/1",
        "points": [asdict(point) for point in curve.points],
        "participants": curve.participants,
        "careless": curve.careless,
        "flat": curve.flat,
        "peak_percent": None if curve.flat else curve.observer.peak,
        "peak_interval": curve.peak_interval,
        "just_noticeable_percent": None if curve.flat else curve.observer.noticeable,
        "just_noticeable_interval": curve.noticeable_interval,
    }
