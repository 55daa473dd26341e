"""Measure the accuracy of the scale estimate and write `docs/evidence/accuracy.md`.

    python -m benchmarks.accuracy --quick                                   # a few minutes, builds no tree
    python -m benchmarks.accuracy --raw RAW --cache DIR --scenes DIR        # the complete report

RAW contains raw items (`metric-tree import`). A tree is built in the cache without the sources of ScanNet, whose rooms
are evaluated, and without one fold of the other items, from which the sizes of synthetic rooms are drawn. Without RAW
the synthetic rooms have typical sizes, and the parts `unseen` and `streets` are skipped. The report uses seeds below
1000; constants are tuned on seeds from 1000 on.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path

import metric_tree
from benchmarks.accuracy.cases import scenes_on_disk, synthetic_rooms, synthetic_streets
from benchmarks.accuracy.methods import scene_outcomes
from benchmarks.accuracy.outcomes import Outcome, read_outcomes, write_outcomes
from benchmarks.accuracy.page import Facts, page
from benchmarks.accuracy.simulations import COUNTS, NOISES, error_outcomes, sameness_outcomes, structured_outcomes
from benchmarks.accuracy.streets import MEASURED, streets_outcomes
from benchmarks.accuracy.unseen import FAMILY, tree_without, unseen_outcomes, unseen_tree
from benchmarks.common import ROOT, SHARED, options_parser
from benchmarks.estimator.simulation import World, world
from metric_base.files import whole_file
from metric_tree.tree import Tree
from tests.synthetic.rooms.sizes import Sizes, typical_sizes

TEMPLATE = Path(__file__).with_name("page.md")
PARTS = ("sameness", "structured", "errors", "unseen", "streets", "scenes", "methods")
#: Options that `--quick` replaces.
QUICK = {"rooms": [0], "streets": [0, 1], "scenes_a_cell": 10}
#: Seed of the simulations.
SEED = 1
#: Maximum number of real rooms of an unseen source, without and with `--quick`.
MAX_UNSEEN_ROOMS = 300
MAX_QUICK_ROOMS = 20
#: Parts that evaluate trees built from raw items.
RAW_PARTS = ("unseen", "streets")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the selected parts, store their outcomes and write the page."""
    arguments = _arguments(argv)
    started = time.process_time()
    outcomes = read_outcomes(arguments.rows) if arguments.rows and arguments.rows.exists() else []
    kept = [outcome for outcome in outcomes if outcome.part not in arguments.parts]
    release = metric_tree.open()
    rooms_tree, sizes = unseen_tree(arguments.raw, arguments.cache) if arguments.raw else (release, typical_sizes)
    for part in arguments.parts:
        if part in RAW_PARTS and not arguments.raw:
            continue
        begun = time.process_time()
        new = list(_outcomes(part, arguments, release, rooms_tree, sizes))
        kept += new
        print(f"{part}: {len(new)} outcomes, {time.process_time() - begun:.0f} s", file=sys.stderr)
        if arguments.rows:
            write_outcomes(kept, arguments.rows)
    arguments.out.mkdir(parents=True, exist_ok=True)
    facts = Facts(
        command=arguments.command,
        earlier=tuple(dict.fromkeys(outcome.part for outcome in kept if outcome.part not in arguments.parts)),
        release=release.version,
        rooms=_rooms_text(arguments),
        minutes=(time.process_time() - started) / 60,
    )
    with whole_file(arguments.out / "accuracy.md") as target:
        target.write_text(page(kept, facts, TEMPLATE.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__)
    parser.add_argument("--scenes", type=Path, action="append", default=[], help="folder of scenes with a truth.json")
    parser.add_argument("--raw", type=Path, help="folder of raw items")
    parser.add_argument("--cache", type=Path, default=Path("/tmp/accuracy"), help="folder of the built trees")  # noqa: S108
    parser.add_argument("--tables", type=Path, default=SHARED / "sizes", help="folder with the tables of real rooms")
    parser.add_argument("--rooms", type=int, nargs="+", default=[0, 1, 2, 3], help="seeds of each kind of room")
    parser.add_argument("--streets", type=int, nargs="+", default=list(range(8)), help="seeds of streets")
    parser.add_argument("--scenes-a-cell", type=int, default=300, help="number of simulated scenes per setting")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--rows", type=Path, help="file of outcomes; parts that are not run are read from it")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "evidence")
    parser.add_argument("--quick", action="store_true", help="run a few scenes of each part")
    arguments = parser.parse_args(argv)
    words = sys.argv[1:] if argv is None else argv
    arguments.command = shlex.join(["python", "-m", "benchmarks.accuracy", *words])
    vars(arguments).update(QUICK if arguments.quick else {})
    return arguments


def _outcomes(
    part: str, arguments: argparse.Namespace, release: Tree, rooms_tree: Tree, sizes: Sizes
) -> Iterator[Outcome]:
    makers: dict[str, Callable[[], Iterator[Outcome]]] = {
        "methods": lambda: _by_method(arguments, rooms_tree, sizes),
        "scenes": lambda: _on_disk(arguments, release),
        "sameness": lambda: sameness_outcomes(_classes(release), arguments.scenes_a_cell, SEED),
        "structured": lambda: _simulated(arguments, release),
        "errors": lambda: error_outcomes(_classes(release), arguments.scenes_a_cell, SEED),
        "unseen": lambda: _unseen(arguments, rooms_tree),
        "streets": lambda: streets_outcomes(
            arguments.tables, tree_without((*FAMILY, *MEASURED), arguments.raw, arguments.cache / "streets"), SEED
        ),
    }
    return makers[part]()


def _by_method(arguments: argparse.Namespace, tree: Tree, sizes: Sizes) -> Iterator[Outcome]:
    """Evaluate all methods on synthetic scenes, with a tree that was built without their sizes."""
    for synthetic in (synthetic_rooms(arguments.rooms, sizes), synthetic_streets(arguments.streets, sizes)):
        for case in synthetic:
            yield from scene_outcomes("methods", case, tree)


def _on_disk(arguments: argparse.Namespace, release: Tree) -> Iterator[Outcome]:
    """Evaluate all methods on scenes on disk, with the release."""
    for folder in arguments.scenes:
        for case in scenes_on_disk(folder):
            yield from scene_outcomes("scenes", case, release)


@cache
def _classes(release: Tree) -> World:
    """Return the classes of the simulations with the paper's mixtures (half a minute; cached for all parts)."""
    return world(release, seed=SEED)


def _simulated(arguments: argparse.Namespace, release: Tree) -> Iterator[Outcome]:
    cells = ((1, 3, 10), (0.0, 0.06, 0.15)) if arguments.quick else (COUNTS, NOISES)
    return structured_outcomes(_classes(release), arguments.scenes_a_cell, SEED, *cells)


def _unseen(arguments: argparse.Namespace, tree: Tree) -> Iterator[Outcome]:
    file = arguments.tables / FAMILY[0] / f"{FAMILY[0]}.csv"
    return unseen_outcomes(file, tree, MAX_QUICK_ROOMS if arguments.quick else MAX_UNSEEN_ROOMS, SEED)


def _rooms_text(arguments: argparse.Namespace) -> str:
    if arguments.raw is None:
        return "typical sizes (`tests/synthetic/rooms/sizes.py`), which no fit has seen"
    return "real items of one fold in five, which their tree did not see, nor any source of ScanNet"


if __name__ == "__main__":
    sys.exit(main())
