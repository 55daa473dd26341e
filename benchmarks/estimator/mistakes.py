"""Estimate the scale of ten scenes with each of 45 user mistakes, and count right, refused and wrong results.

    python -m benchmarks.estimator.mistakes [--synthetic SEED] [--json FILE] [--scene WORDS] [--only WORDS]

Real scenes are read from `../shared/data/scenes` if they exist. `--synthetic SEED` runs ten synthetic scenes instead:
thresholds are tuned on seeds from 40 on, never on the scenes of the table.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import metric_tree
from benchmarks.common import ROOT, SHARED, options_parser, print_rows
from benchmarks.estimator.mistake_cases import MISTAKES, MUNICH, RIGHT, SEOUL, Base, Case, masks_of
from estimator import pipeline
from estimator.evidence.gps import Gps
from estimator.instances.instance_reader import read_instances
from estimator.pipeline import estimate_scene, measure_objects
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.objects import Measurements
from estimator.records.options import EstimateOptions
from estimator.records.result import ScaleResult
from metric_base.errors import InputError
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.rooms.street import street

REAL = ("tum_office", "red_kitchen", "walk_carpark", "lund_street")
INTERNAL = "internal error"
OUTCOMES = ("wrong and silent", "wrong with a warning", INTERNAL, "refused", "right")
#: Factor of the uncertainty of a true scale if `truth.json` does not state one.
TOLERANCE = 1.02
#: Number of dense points per frame. Without them the outcomes are equal and the benchmark is faster.
DENSE_POINTS = 0


def bases(seed: int | None) -> Iterator[Base]:
    """Yield the ten scenes of the table, or ten synthetic scenes."""
    if seed is not None:
        for index, kind in enumerate([*KINDS, *KINDS]):
            yield synthetic_base(kind, seed + index)
        return
    folders = [ROOT / "data" / "scenes" / "demo_room", *(SHARED / "scenes" / name for name in REAL)]
    for index, folder in enumerate(folders):
        if not folder.is_dir():
            continue
        scene, truth = read_scene(folder, "none"), json.loads((folder / "truth.json").read_text())
        scale = truth["metres_per_unit"]
        tolerance = max(TOLERANCE, 1 + truth.get("plus_minus", 0.0) / scale)
        masks = tuple(masks_of(scene, read_instances(None, scene)))
        yield Base(folder.name, scene, masks, scale, tolerance, (MUNICH, SEOUL)[index % 2])
    for index, kind in enumerate([*list(KINDS)[:4], "street"]):
        yield synthetic_base(kind, 7 + index)


def synthetic_base(kind: str, seed: int) -> Base:
    """Return a furnished room, or a street."""
    world = street(seed) if kind == "street" else furnished_room(kind, seed)
    room = quick_scene(world, seed=seed, dense_a_frame=DENSE_POINTS)
    masks = tuple(masks_of(room.scene, room.instances))
    name = f"{kind} {seed}"
    return Base(name, room.scene, masks, room.truth.metres_per_unit, TOLERANCE, (MUNICH, SEOUL)[seed % 2])


def result_of(case: Case, tree: metric_tree.Tree) -> ScaleResult | str:
    """Return the result, or the message of a refusal."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "instances.json"
        table = (Gps(case.write_positions(Path(folder) / "gps.csv")),) if case.positions else ()
        sources = (*table, *case.sources)
        if case.dataset is not None:
            file.write_text(json.dumps(case.dataset))
        try:
            masks = None if case.dataset is None else file
            scene = replace(case.scene, path=Path(folder), model_path=None)  # the real folders contain masks
            options = EstimateOptions(up=case.up, evidence=case.evidence)
            with patch.object(pipeline, "measure_objects", lambda *given: _with_models(measure_objects(*given), case)):
                return estimate_scene(scene, tree, options, instances=masks, sources=sources).result
        except InputError as error:
            return re.sub(r"\S*/(?=\w)", "", str(error))
        except Exception as error:  # noqa: BLE001 - the command reports it as an internal error
            return f"{INTERNAL}: {error!r}"


def _with_models(measurements: Measurements, case: Case) -> Measurements:
    """Replace a part of the measured objects by models."""
    objects = list(measurements.objects)
    rows = np.random.default_rng(4).permutation(len(objects))[: round(case.models * len(objects))]
    for row in rows:
        objects[row] = replace(objects[row], extents=objects[row].extents / case.model_ratio)
    return replace(measurements, objects=tuple(objects))


def outcome(base: Base, result: ScaleResult | str, usual: set[str]) -> dict[str, Any]:
    """Classify the result of a case.

    usual : warnings and assumptions of the same scene without a mistake, with numbers replaced (`plain`).
    """
    if isinstance(result, str):
        return {"outcome": INTERNAL if result.startswith(INTERNAL) else "refused", "ratio": None, "words": result}
    new = [line for line in stated(result) if plain(line) not in usual]
    if result.scale is None or result.interval is None:
        return {"outcome": "refused", "ratio": None, "words": plain(next(iter(new[::-1]), ""))}
    low, high = result.interval.low / base.tolerance, result.interval.high * base.tolerance
    right = low <= base.metres_per_unit <= high
    warned = bool(new) or result.status != "resolved"
    words = plain(next(iter(new), ""))
    name = "right" if right else "wrong with a warning" if warned else "wrong and silent"
    ratio = round(result.scale / base.metres_per_unit, 3)
    return {"outcome": name, "ratio": ratio, "words": words, "status": result.status}


def stated(result: ScaleResult) -> list[str]:
    """Return the warnings, and the assumptions about other evidence, such as "taken as metres"."""
    return [*result.warnings, *(item.reason for item in result.evidence if item.verdict == "used" and item.reason)]


def plain(line: str) -> str:
    """Return a warning without folders, with its numbers replaced by #."""
    return re.sub(r"[\d.]+", "#", re.sub(r"\S*/(?=\w)", "", line))


def run(options: argparse.Namespace) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the outcomes by scene and mistake. Cases without a mistake have names `right: ...`."""
    tree = metric_tree.open()
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    for base in bases(options.synthetic):
        if not re.search(options.scene, base.name):
            continue
        row = rows.setdefault(base.name, {})
        usual: set[str] = set()
        for name, make in RIGHT.items():
            result = result_of(make(base), tree)
            usual |= set() if isinstance(result, str) else set(map(plain, stated(result)))
            row[f"right: {name}"] = outcome(base, result, usual)
        for name, make in MISTAKES.items():
            if not re.search(options.only, name):
                continue
            row[name] = outcome(base, result_of(make(base), tree), usual)
        counts = Counter(cell["outcome"] for name, cell in row.items() if not name.startswith("right"))
        print(base.name, dict(counts), file=sys.stderr, flush=True)
        if options.json is not None:
            options.json.write_text(json.dumps(rows, indent=1) + "\n")
    return rows


def table(rows: dict[str, dict[str, dict[str, Any]]]) -> Iterator[tuple[object, ...]]:
    """Yield the counts of the outcomes of each mistake, and the scale ratios of wrong results without a warning."""
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    for title, right in (("", False), ("without a mistake: ", True)):
        part = [name for name in names if name.startswith("right: ") == right]
        cells = {name: [row[name] for row in rows.values() if name in row] for name in part}
        for name in part:
            counts = Counter(cell["outcome"] for cell in cells[name])
            silent = [f"{cell['ratio']:.2f}" for cell in cells[name] if cell["outcome"] == OUTCOMES[0]]
            yield title + name.removeprefix("right: "), *(counts[outcome] for outcome in OUTCOMES), ", ".join(silent)
        total = Counter(cell["outcome"] for name in part for cell in cells[name])
        cases = max(sum(total.values()), 1)
        fractions = (f"**{total[outcome]}** ({total[outcome] / cases:.1%})" for outcome in OUTCOMES)
        yield f"**{title or 'mistakes: '}all {cases}**", *fractions, ""


def main() -> None:
    """Run the benchmark and print the table."""
    parser = options_parser(__doc__)
    parser.add_argument("--synthetic", type=int, metavar="SEED")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the outcomes to this file")
    parser.add_argument("--only", default="", metavar="WORDS", help="run only mistakes with these words in the name")
    parser.add_argument("--scene", default="", metavar="WORDS", help="run only scenes with these words in the name")
    print_rows(("mistake", *OUTCOMES, "stated / true where wrong and silent"), table(run(parser.parse_args())))


if __name__ == "__main__":
    main()
