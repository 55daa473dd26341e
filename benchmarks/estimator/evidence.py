"""Every kind of evidence on scenes whose scale is known.

    python -m benchmarks.estimator.evidence [--write]

prints the tables of docs/evidence/other-evidence.md, and writes them there with `--write`:

- each kind right, wrong by two alone, wrong by two with four right objects, and right with objects of half their
  size (a model room): interval by the true scale, and verdict;
- `--up` right, tilted and upside down on the demo scene;
- coverage of the 90 % interval on simulated scenes (`benchmarks.estimator.simulation`) with one to three kinds, alone
  and with three objects, one piece of evidence in ten wrong by up to a factor of seven.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import estimator
import metric_tree
from benchmarks.common import options_parser, row_text, table_head
from benchmarks.estimator.simulation import Knobs, simulated, world
from estimator.pipeline import measure_objects
from estimator.posterior.object_likelihood import ObjectEvidence
from estimator.posterior.posterior import posterior
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.options import EstimateOptions
from estimator.records.result import DOUBT, ScaleResult
from estimator.results.estimate import scale_of_objects
from metric_base.arrays import FloatArray
from metric_tree.tree import Tree
from tests.synthetic.evidence import KINDS, RIG_M, objects_of
from tests.synthetic.walk import Walk, synthetic_walk, with_rig

PAGE = Path("docs/evidence/other-evidence.md")
DEMO = Path("data/scenes/demo_room")
OBJECTS = ("chair", "table", "bookcase", "couch")
#: Standard deviations of the log scale of simulated evidence: height of a hand-held camera, positions, a marker, the
#: metric depth of a network.
LOG_SDS = {"camera height": 0.107, "GPS": 0.02, "marker": 0.01, "metric depth": 0.15}
#: Maximum error of the log scale of wrong evidence, in both directions.
MAX_WRONG_LOG = 2.0
LEVEL = 0.9
#: Kinds whose rows are those of another kind in every digit: they share its code after the file is read.
EQUAL_KINDS = {"AprilTag", "ChArUco", "depth, PFM", "depth, PNG"}
#: Columns of the table of the kinds.
CASES = (
    "right, four objects|twice too large, no objects|twice too large, four objects|right, objects of half their size"
)
Row = Sequence[object]


def kind_rows(tree: Tree, folder: Path) -> Iterator[Row]:
    """Yield the kind and its result in each of the `CASES`; scales are relative to the true scale."""
    walk = with_rig(synthetic_walk(folder, views=12), RIG_M)
    shown = measure_objects(walk.scene, ())
    right = objects_of(tree, OBJECTS, walk.scale)
    small = objects_of(tree, OBJECTS, 2 * walk.scale)
    yield ("none", _result_cell(scale_of_objects(right, tree), walk), None, None, None)
    for name, kind in KINDS.items():
        if name in EQUAL_KINDS:
            continue
        (true,), (wrong,) = (kind.rows(walk, shown, factor) for factor in (1.0, 2.0))
        cells = []
        for evidence, objects in ((true, right), (wrong, []), (wrong, right), (true, small)):
            result = scale_of_objects(objects, tree, EstimateOptions(evidence=(evidence,)))
            (row,) = result.evidence
            cells.append(f"{_result_cell(result, walk)}, {row.verdict}")
        yield name, *cells


def _result_cell(result: ScaleResult, walk: Walk) -> str:
    """Return the interval relative to the true scale, or the modes of an unresolved scale."""
    if result.interval is None:
        return "unresolved (" + ", ".join(f"{mode.scale / walk.scale:.2f}" for mode in result.modes) + ")"
    return " to ".join(f"{value / walk.scale:.2f}" for value in (result.interval.low, result.interval.high))


def up_rows(tree: Tree) -> Iterator[Row]:
    """Yield the results of the demo scene without up, with the true up, tilted ups, and gravity instead of up."""
    truth = json.loads((DEMO / "truth.json").read_text(encoding="utf-8"))
    up = np.array(truth["up_in_scene"])
    aside = np.cross(up, [1.0, 0, 0]) / np.linalg.norm(np.cross(up, [1.0, 0, 0]))
    scene = read_scene(DEMO)
    masks = estimator.read_instances(None, scene)
    ups: dict[str, FloatArray | None] = {
        "not given": None,
        "right": up,
        "off by 2°": _tilted(up, aside, 2),
        "off by 25°": _tilted(up, aside, 25),
        "gravity": -up,
    }
    for name, vector in ups.items():
        result = estimator.estimate_scale(scene, masks, tree, up=None if vector is None else vector.tolist())
        warning = next((line for line in result.warnings if "given up" in line), "–")
        if result.scale is None or result.interval is None:
            yield name, "unresolved", "–", warning
            continue
        low, high = result.interval.low, result.interval.high
        true = truth["metres_per_unit"]
        yield name, f"{result.scale / true:.2f}", f"{low / true:.2f} to {high / true:.2f}", warning


def _tilted(up: FloatArray, aside: FloatArray, degrees: float) -> FloatArray:
    angle = math.radians(degrees)
    return np.asarray(math.cos(angle) * up + math.sin(angle) * aside)


def coverage_rows(tree: Tree, scenes: int) -> Iterator[Row]:
    """Yield objects, evidence, wrong evidence, coverage, median and mean error, and log width of the interval."""
    classes = world(tree, baselines=False)
    knobs = Knobs(objects=3, classes=3)
    plans: list[tuple[int, tuple[str, ...], bool]] = [(3, (), False)]
    plans += [(3, (name,), False) for name in LOG_SDS]
    plans += [(objects, ("any",) * count, True) for objects in (0, 3) for count in (1, 2, 3)]
    for objects, names, may_fail in plans:
        values = []
        for seed in range(scenes):
            generator = np.random.default_rng([7, seed])
            scale, entries = simulated(classes, knobs, generator)
            evidence = [
                ObjectEvidence(item, classes.priors[row], classes.nodes[row].pose) for row, item in entries[:objects]
            ]
            lines = _lines(names, math.log(scale), may_fail, generator)
            estimate = posterior(evidence, lines, LEVEL)
            low, high = estimate.interval
            error = abs(estimate.modes[0].scale / scale - 1)
            values.append((low <= scale <= high, error, math.log(high / low)))
        inside, error, width = np.array(values, dtype=float).T
        label = f"{len(names)} of them" if may_fail else ", ".join(names) or "none"
        errors = "one in ten" if may_fail else "none"
        mean = f"{error.mean():.3f}"
        yield objects, label, errors, f"{inside.mean():.2f}", f"{np.median(error):.3f}", mean, f"{width.mean():.2f}"


def _lines(names: Sequence[str], truth: float, may_fail: bool, generator: np.random.Generator) -> FloatArray:
    """Return mean, standard deviation and outlier probability (k, 3) of k kinds; "any" is a random kind."""
    rows = []
    for name in names:
        log_sd = LOG_SDS[str(generator.choice(list(LOG_SDS))) if name == "any" else name]
        wrong = may_fail and generator.random() < DOUBT
        mean = truth + (generator.uniform(-MAX_WRONG_LOG, MAX_WRONG_LOG) if wrong else generator.normal(0, log_sd))
        rows.append((mean, log_sd, DOUBT))
    return np.array(rows, dtype=float).reshape(-1, 3)


def _table(header: str, rows: Iterator[Row]) -> str:
    return "\n".join([table_head(header.split("|")), *(row_text("–" if c is None else c for c in row) for row in rows)])


def page(tree: Tree, scenes: int) -> str:
    """Return the text of the page with all tables."""
    with tempfile.TemporaryDirectory() as folder:
        kinds = _table(f"evidence|{CASES}", kind_rows(tree, Path(folder)))
    ups = _table("`--up`|scale|90 % interval|warning", up_rows(tree))
    header = "objects|other evidence|of it wrong|coverage|median error|mean error|width (log)"
    coverage = _table(header, coverage_rows(tree, scenes))
    text = Path(__file__).with_suffix(".md").read_text(encoding="utf-8")
    return text.format(version=tree.version, kinds=kinds, ups=ups, coverage=coverage, scenes=scenes)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the page, and write it with `--write`."""
    parser = options_parser(__doc__)
    parser.add_argument("--scenes", type=int, default=300, help="simulated scenes per row (default: %(default)s)")
    parser.add_argument("--write", action="store_true", help=f"write {PAGE}")
    options = parser.parse_args(argv)
    text = page(metric_tree.open(), options.scenes)
    print(text, end="")
    if options.write:
        PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
