"""Evaluate absolute scale: estimates of any method on scenes of known scale.

    python -m benchmarks.absolute_scale --list                              # the scenes
    python -m benchmarks.absolute_scale --predictions NAME=predictions.csv [--tuned-on NAME=SCENE ...]
    python -m benchmarks.absolute_scale --write                             # also writes the page's table

Scenes are folders with a COLMAP model in `sparse` and a known scale: `truth.json` (`metres_per_unit`), or the camera
positions of ETH3D, TUM RGB-D or 7-Scenes (`benchmarks.public_sets`); `--scenes DIR` adds those below DIR. A rendered
walk has files of GPS, markers and a camera height. `predictions.csv` has the columns scene, scale, low, high and
perhaps seconds; a scene without a row, or with an empty scale, is a refusal.

Errors of the scale s' against the true s are |s' - s| / s (its mean is `metric_scale_abs_rel` of MapAnything) and
|ln(s' / s)|. The interval score is (h - l) + 2 / (1 - level) * (distance of the truth outside), with l and h the ends
of ln s'.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import metric_tree
from benchmarks.common import ROOT, SHARED, options_parser, row_text, table_head, write_between
from benchmarks.public_sets import is_public_scene, public_scale
from capture.recorded_sources import recorded_sources
from estimator.evidence.imu import Imu
from estimator.evidence.source import CameraPath
from estimator.instances.instance_reader import read_instances
from estimator.outputs.ground_truth import read_truth
from estimator.pipeline import estimate_scene, measure_objects
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.options import EstimateOptions
from estimator.records.result import ScaleResult
from estimator.records.scene import InstanceSet
from estimator.results.estimate import scale_of_objects
from estimator.telemetry.records import Telemetry
from metric_base.errors import InputError
from metric_base.parsing import table_rows
from metric_cli.errors import exit_status
from metric_tree.tree import Tree
from tests.synthetic.evidence import KINDS, RIG_M
from tests.synthetic.telemetry import walk_readings
from tests.synthetic.walk import synthetic_walk, with_rig

PAGE = ROOT / "docs" / "evidence" / "absolute-scale.md"
LEVEL = 0.9
OURS = {"default": "objects", "height": "heights only", "paper": "method of the paper", "sucar": "Sucar and Hayet"}
#: Evidence of the rendered walk that is evaluated alone.
WALK = "rendered_walk"
#: A simulated walk with a carried inertial unit, whose truth is the same.
IMU_WALK = "inertial_walk"
WALK_KINDS = ("camera height", "GPS, EXIF", "positions, metres", "ArUco", "depth, npy", "baseline")
#: Duration, rate and swing of the carried inertial unit of a simulated walk, and noise of the camera path.
IMU_SECONDS, IMU_RATE_HZ, IMU_SWING_M, PATH_NOISE_M = 26.0, 200.0, 0.02, 0.003
#: Number of readings per frame of this walk.
READINGS_PER_FRAME = 8
#: Sensors from which the truth of a scene was computed, which are therefore not evaluated on it.
TRUTH_SENSORS = {"lund_street": "recorded GPS and IMU", "walk_carpark": "recorded GPS and IMU"}
#: Scenes that were seen while our methods were developed; results on them are marked.
SEEN = {"demo_room", "lund_street", "red_kitchen", "tum_office", "walk_carpark"}
#: Mean relative errors of networks on pairs of images of 13 scenes of ETH3D, for the figure: metric_scale_abs_rel in
#: github.com/Asher-1/map-anything-ggml, cpp_ggml/benchmarks/results/{mapanything,pi3x}/bench_official_eth3d_*.md.
REPORTED = {"MapAnything, ETH3D": 0.16, "Pi3X, ETH3D": 0.25}


@dataclass(frozen=True, slots=True)
class Prediction:
    """The estimate of a method on a scene, or a refusal (`scale` is None)."""

    method: str
    scene: str
    scale: float | None
    low: float | None
    high: float | None
    seconds: float | None
    is_ranked: bool = True  #: The method was not tuned on the scene, and has not seen it.


def scene_folders(extra: Sequence[Path]) -> dict[str, Path]:
    """Return the scenes with a true scale by name; a later folder of the same name replaces an earlier one.

    Sequences of public sets are one folder lower: their names are `SCENE/SEQUENCE`.
    """
    roots = [ROOT / "data" / "scenes", SHARED / "scenes", *extra]
    models = [(root, path.parent) for root in roots for form in ("*/sparse", "*/*/sparse") for path in root.glob(form)]
    folders = {path.relative_to(root).as_posix(): path for root, path in models}
    return {name: path for name, path in folders.items() if read_truth(path).scale or is_public_scene(path)}


def true_scale(folder: Path) -> float:
    """Return the metres per unit of a scene; InputError if the files of a public set do not determine them."""
    return read_truth(folder).scale or public_scale(folder)


def our_predictions(folders: dict[str, Path], tree: Tree) -> Iterator[Prediction]:
    """Yield the predictions of our methods by objects, and by the sensors of the recording without objects."""
    for name, folder in folders.items():
        scene = read_scene(folder)
        masks = InstanceSet(tuple(read_instances(None, scene)))
        for method, label in OURS.items():
            started = time.perf_counter()
            result = estimate_scene(scene, tree, EstimateOptions(method=method, level=LEVEL), instances=masks).result
            yield _prediction(label, name, result, started, is_ranked=name not in SEEN)
        sources = recorded_sources(folder, scene)
        if sources and name not in TRUTH_SENSORS:
            started = time.perf_counter()
            options = EstimateOptions(level=LEVEL)
            result = estimate_scene(scene, tree, options, instances=InstanceSet(()), sources=sources).result
            yield _prediction("recorded GPS and IMU", name, result, started, is_ranked=name not in SEEN)


def walk_predictions(tree: Tree) -> Iterator[Prediction]:
    """Yield the predictions of single kinds of evidence on the rendered walk, relative to its true scale."""
    with tempfile.TemporaryDirectory() as folder:
        walk = with_rig(synthetic_walk(Path(folder), views=12), RIG_M)
        shown = measure_objects(walk.scene, ())
        for kind in WALK_KINDS:
            started = time.perf_counter()
            evidence = KINDS[kind].rows(walk, shown)
            result = scale_of_objects([], tree, EstimateOptions(level=LEVEL, evidence=evidence))
            yield _prediction(kind, WALK, result, started, unit=walk.scale)
        started = time.perf_counter()
        times, centres, force, rate = walk_readings(IMU_SECONDS, IMU_RATE_HZ, IMU_SWING_M)
        noisy = centres + np.random.default_rng(1).normal(0, PATH_NOISE_M, centres.shape)
        path = CameraPath(times[::READINGS_PER_FRAME], noisy[::READINGS_PER_FRAME] / walk.scale)
        evidence = Imu(Telemetry(specific_force=force, angular_rate=rate), path, "unit").observe(walk.scene, shown)
        result = scale_of_objects([], tree, EstimateOptions(level=LEVEL, evidence=evidence))
        yield _prediction("inertial unit", IMU_WALK, result, started, unit=walk.scale)


def _prediction(
    method: str, scene: str, result: ScaleResult, started: float, unit: float = 1.0, is_ranked: bool = True
) -> Prediction:
    seconds = time.perf_counter() - started
    if result.scale is None or result.interval is None:
        return Prediction(method, scene, None, None, None, seconds, is_ranked)
    ends = result.interval.low / unit, result.interval.high / unit
    return Prediction(method, scene, result.scale / unit, *ends, seconds, is_ranked)


def read_predictions(entry: str, scenes: Sequence[str], tuned_on: Sequence[str]) -> Iterator[Prediction]:
    """Yield a prediction for each scene from NAME=FILE; scenes in `tuned_on` (NAME=SCENE) are not ranked.

    Raises
    ------
    InputError
        The entry, a scene or a value is invalid, or an interval does not contain its scale.
    """
    name, separator, file = entry.partition("=")
    if not (name and separator):
        raise InputError.at("--predictions", "value", "NAME=FILE", entry)
    rows = {
        cells["scene"]: (place, cells) for place, cells in table_rows(Path(file), ["scene", "scale", "low", "high"])
    }
    for scene, (place, _) in rows.items():
        if scene not in scenes:
            raise InputError.at(place, "scene", f"one of {', '.join(scenes)} (--list)", scene)
    seconds = {cells["scene"]: cells["seconds"] for _, cells in _with_seconds(Path(file))}
    for scene in scenes:
        place, cells = rows.get(scene, (file, {"scale": "", "low": "", "high": ""}))
        try:
            scale, low, high = (float(cells[one]) if cells[one] else None for one in ("scale", "low", "high"))
            time_s = float(seconds[scene]) if seconds.get(scene) else None
        except ValueError:
            raise InputError.at(place, "scale, low, high, seconds", "numbers", dict(cells)) from None
        if (scale is not None and not (low or scale) <= scale <= (high or scale) < math.inf) or (
            low or scale or 1
        ) <= 0:
            raise InputError.at(place, "scale", "a positive number within low and high", (scale, low, high))
        yield Prediction(name, scene, scale, low, high, time_s, f"{name}={scene}" not in tuned_on)


def _with_seconds(file: Path) -> list[tuple[str, dict[str, str]]]:
    """Return the rows of a file with the optional column `seconds`; none without it."""
    if "seconds" not in file.read_text(encoding="utf-8").partition("\n")[0].split(","):
        return []
    return list(table_rows(file, ["scene", "seconds"]))


def table(predictions: Sequence[Prediction], truths: dict[str, float]) -> str:
    """Return a Markdown table with a row for each method, ranked scenes first; seen ones are separate rows."""
    errors_of = ["mean, %", "median, %", "mean abs(ln)"]
    columns = ["method", "scenes", "refused", *errors_of, "coverage", "interval score", "seconds"]
    groups: dict[tuple[str, bool], list[Prediction]] = defaultdict(list)
    for one in predictions:
        groups[one.method, one.is_ranked].append(one)
    lines = [table_head(columns)]
    for (method, is_ranked), rows in sorted(groups.items(), key=lambda item: not item[0][1]):
        given = [(one, math.log(truths[one.scene])) for one in rows if one.scale is not None]
        errors = np.array([math.log(one.scale or 1) - truth for one, truth in given])
        ends = [(math.log(one.low) - truth, math.log(one.high) - truth) for one, truth in given if one.low and one.high]
        scores = [high - low + 2 / (1 - LEVEL) * max(low, -high, 0.0) for low, high in ends]
        times = [one.seconds for one in rows if one.seconds is not None]
        label = method if is_ranked else f"{method} (scenes seen)"
        cells = [
            f"{100 * np.abs(np.expm1(errors)).mean():.1f}" if given else "–",
            f"{100 * np.median(np.abs(np.expm1(errors))):.1f}" if given else "–",
            f"{np.abs(errors).mean():.3f}" if given else "–",
            f"{np.mean([low <= 0 <= high for low, high in ends]):.2f}" if ends else "–",
            f"{np.mean(scores):.2f}" if ends else "–",
            f"{np.median(times):.1f}" if times else "–",
        ]
        lines.append(row_text([label, len(rows), len(rows) - len(given), *cells]))
    return "\n".join(lines)


def write_figure(predictions: Sequence[Prediction], truths: dict[str, float], file: Path) -> None:
    """Draw the ratio of each estimate to the truth by method, with intervals and the reported errors of networks."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    methods = list(dict.fromkeys(one.method for one in predictions))
    scenes = list(dict.fromkeys(one.scene for one in predictions))
    figure, axes = plt.subplots(figsize=(9, 1.6 + 0.42 * len(methods)), layout="constrained")
    for row, scene in enumerate(scenes):
        shown = [one for one in predictions if one.scene == scene and one.scale]
        ratios = np.array([one.scale or 1 for one in shown]) / truths[scene]
        places = np.array([methods.index(one.method) for one in shown]) + 0.6 * ((row + 0.5) / len(scenes) - 0.5)
        ends = np.array([[one.low or one.scale, one.high or one.scale] for one in shown], float).reshape(-1, 2)
        spans = np.abs(ends.T / truths[scene] - ratios)
        axes.errorbar(ratios, places, xerr=spans, fmt="o", markersize=4, linewidth=1, label=scene)
    for (name, error), style in zip(REPORTED.items(), ("--", ":"), strict=True):
        for side in (1 / (1 + error), 1 + error):
            axes.axvline(
                side, color="0.5", linestyle=style, label=f"{name}: mean error {error:g}" if side > 1 else None
            )
    axes.axvline(1, color="k", linewidth=0.8)
    axes.set_xscale("log")
    ticks = [0.1, 0.2, 0.3, 0.5, 0.7, 1, 1.4, 2, 3]
    low, high = axes.get_xlim()
    shown_ticks = [tick for tick in ticks if low <= tick <= high]
    axes.set_xticks(shown_ticks, [f"{tick:g}" for tick in shown_ticks])
    axes.xaxis.minorticks_off()
    axes.set_yticks(range(len(methods)), methods)
    axes.invert_yaxis()
    axes.set_xlabel("estimated / true scale, with the stated interval")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8)
    figure.savefig(file, dpi=120)
    plt.close(figure)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, and write the figure and the page; return the exit status."""
    options = _options(argv)
    return exit_status("absolute_scale", lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    folders = scene_folders(options.scenes)
    methods = [entry.partition("=")[0] for entry in options.predictions]
    for entry in options.tuned_on:
        method, _, scene = entry.partition("=")
        if method not in methods or scene not in folders:
            expected = f"NAME=SCENE with a NAME of --predictions ({', '.join(methods) or 'none'}) and a SCENE of --list"
            raise InputError.at("--tuned-on", "value", expected, entry)
    if options.list:
        print("\n".join(f"{name}\t{folder}" for name, folder in folders.items()))
        return 0
    truths = {name: true_scale(folder) for name, folder in folders.items()} | {WALK: 1.0, IMU_WALK: 1.0}
    tree = metric_tree.open()
    predictions = [] if options.only_predictions else [*our_predictions(folders, tree), *walk_predictions(tree)]
    for entry in options.predictions:
        predictions += read_predictions(entry, list(folders), options.tuned_on)
    text = table(predictions, truths)
    print(text)
    if options.figure:
        write_figure(predictions, truths, options.figure)
    if options.write:
        write_between(PAGE, "table", text)
    return 0


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__)
    parser.add_argument("--scenes", type=Path, action="append", default=[], help="folder of scenes with a truth.json")
    parser.add_argument("--predictions", metavar="NAME=FILE", action="append", default=[], help="estimates of a method")
    parser.add_argument(
        "--tuned-on", metavar="NAME=SCENE", action="append", default=[], help="scene that is not ranked"
    )
    parser.add_argument("--only-predictions", action="store_true", help="do not run our methods")
    parser.add_argument("--list", action="store_true", help="print the scenes and their folders")
    parser.add_argument("--figure", type=Path, help="draw all estimates as PNG")
    parser.add_argument("--write", action="store_true", help=f"write the table to {PAGE.name}")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
