"""Thirty mistakes in each of ten scenes: right, refused, or wrong.

    python -m benchmarks.estimator.mistakes [--synthetic SEED] [--json FILE] [--scene WORDS]

Real scenes are those of `../shared/data/scenes` that are there. `--synthetic SEED` takes ten synthetic ones alone:
thresholds are chosen on seeds from 40 on, never on the scenes of the table.
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

import metric_tree
from benchmarks.common import ROOT, SHARED, options_parser, print_rows
from benchmarks.estimator.mistake_cases import MISTAKES, MUNICH, RIGHT, SEOUL, Base, Case, masks_of
from estimator.evidence.gps import Gps
from estimator.instances.instance_reader import read_instances
from estimator.pipeline import estimate_scene
from estimator.reconstructions.scene_reader import read_scene
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
#: How well a scale can be checked where the truth says nothing of its own error.
TOLERANCE = 1.02
#: No dense points: the sparse ones say the same in less time.
DENSE = 0


def bases(seed: int | None) -> Iterator[Base]:
    """The ten scenes of the table, or ten synthetic ones."""
    if seed is not None:
        for number, kind in enumerate([*KINDS, *KINDS]):
            yield _synthetic(kind, seed + number)
        return
    folders = [ROOT / "data" / "scenes" / "demo_room", *(SHARED / "scenes" / name for name in REAL)]
    for number, folder in enumerate(folders):
        if not folder.is_dir():
            continue
        scene, truth = read_scene(folder, "none"), json.loads((folder / "truth.json").read_text())
        scale = truth["metres_per_unit"]
        tolerance = max(TOLERANCE, 1 + truth.get("plus_minus", 0.0) / scale)
        masks = tuple(masks_of(scene, read_instances(None, scene)))
        yield Base(folder.name, scene, masks, scale, tolerance, (MUNICH, SEOUL)[number % 2])
    for number, kind in enumerate([*list(KINDS)[:4], "street"]):
        yield _synthetic(kind, 7 + number)


def _synthetic(kind: str, seed: int) -> Base:
    world = street(seed) if kind == "street" else furnished_room(kind, seed)
    found = quick_scene(world, seed=seed, dense_a_frame=DENSE)
    masks = tuple(masks_of(found.scene, found.instances))
    name = f"{kind} {seed}"
    return Base(name, found.scene, masks, found.truth.metres_per_unit, TOLERANCE, (MUNICH, SEOUL)[seed % 2])


def answer(case: Case, tree: metric_tree.Tree) -> ScaleResult | str:
    """The result, or why it was refused."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "instances.json"
        sources = (Gps(case.write_positions(Path(folder) / "gps.csv")),) if case.positions else ()
        if case.dataset is not None:
            file.write_text(json.dumps(case.dataset))
        try:
            masks = None if case.dataset is None else file
            scene = replace(case.scene, path=Path(folder))  # beside the real one are its own masks
            return estimate_scene(scene, tree, EstimateOptions(up=case.up), instances=masks, sources=sources).result
        except InputError as error:
            return re.sub(r"\S*/(?=\w)", "", str(error))
        except Exception as error:  # noqa: BLE001 - what the command calls an internal error
            return f"{INTERNAL}: {error!r}"


def outcome(base: Base, result: ScaleResult | str, usual: set[str]) -> dict[str, Any]:
    """What became of a case; usual : warnings of the same scene without a mistake, without their numbers."""
    if isinstance(result, str):
        return {"outcome": INTERNAL if result.startswith(INTERNAL) else "refused", "ratio": None, "words": result}
    new = [line for line in result.warnings if _plain(line) not in usual]
    if result.scale is None or result.interval is None:
        return {"outcome": "refused", "ratio": None, "words": _plain(next(iter(new[::-1]), ""))}
    low, high = result.interval.low / base.tolerance, result.interval.high * base.tolerance
    right = low <= base.metres_per_unit <= high
    warned = bool(new) or result.status != "resolved"
    words = _plain(next(iter(new), ""))
    name = "right" if right else "wrong with a warning" if warned else "wrong and silent"
    return {"outcome": name, "ratio": round(result.scale / base.metres_per_unit, 3), "words": words}


def _plain(line: str) -> str:
    return re.sub(r"[\d.]+", "#", re.sub(r"\S*/(?=\w)", "", line))


def run(options: argparse.Namespace) -> dict[str, dict[str, dict[str, Any]]]:
    """Outcomes by scene, then by mistake; those without a mistake are called `right: ...`."""
    tree = metric_tree.open()
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    for base in bases(options.synthetic):
        if not re.search(options.scene, base.name):
            continue
        row = rows.setdefault(base.name, {})
        usual: set[str] = set()
        for name, make in RIGHT.items():
            result = answer(make(base), tree)
            usual |= set() if isinstance(result, str) else {_plain(line) for line in result.warnings}
            row[f"right: {name}"] = outcome(base, result, usual)
        for name, make in MISTAKES.items():
            row[name] = outcome(base, answer(make(base), tree), usual)
        counts = Counter(cell["outcome"] for name, cell in row.items() if not name.startswith("right"))
        print(base.name, dict(counts), file=sys.stderr, flush=True)
        if options.json is not None:
            options.json.write_text(json.dumps(rows, indent=1) + "\n")
    return rows


def table(rows: dict[str, dict[str, dict[str, Any]]]) -> Iterator[tuple[object, ...]]:
    """A line of counts for each mistake, and the ratios of what is wrong and silent."""
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    for title, right in (("", False), ("without a mistake: ", True)):
        part = [name for name in names if name.startswith("right: ") == right]
        cells = {name: [row[name] for row in rows.values() if name in row] for name in part}
        for name in part:
            counts = Counter(cell["outcome"] for cell in cells[name])
            silent = [f"{cell['ratio']:.2f}" for cell in cells[name] if cell["outcome"] == OUTCOMES[0]]
            yield title + name.removeprefix("right: "), *(counts[one] for one in OUTCOMES), ", ".join(silent)
        total = Counter(cell["outcome"] for name in part for cell in cells[name])
        of = max(sum(total.values()), 1)
        shares = (f"**{total[one]}** ({total[one] / of:.1%})" for one in OUTCOMES)
        yield f"**{title or 'mistakes: '}all {of}**", *shares, ""


def main() -> None:
    """Run, and print the table."""
    parser = options_parser(__doc__)
    parser.add_argument("--synthetic", type=int, metavar="SEED")
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep the outcomes")
    parser.add_argument("--scene", default="", metavar="WORDS", help="scenes whose name these words are in")
    print_rows(("mistake", *OUTCOMES, "stated / true where wrong and silent"), table(run(parser.parse_args())))


if __name__ == "__main__":
    main()
