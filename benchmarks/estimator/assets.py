"""How often `check-asset` is right: open models at their true size and with each error put in.

    python -m benchmarks.estimator.assets MODELS [--raw DIR] [--work DIR] [--write docs/evidence/model-sizes.md]

MODELS contains `models.csv` and the files that it names. The priors are from a tree that is built from the raw items
in DIR without the sources of these models (`MODEL_SOURCES`). Categories are split in halves by a hash of their name:
the constants of `models3d` were tuned on the first half, the page reports the second. Models of several objects
(stacks, sets) are skipped, because they have no single size.
"""

from __future__ import annotations

import csv
import hashlib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.common import options_parser, write_between
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_tree.pipeline.build import BuildOptions, build_release
from metric_tree.tree import Tree, open_tree
from models3d.asset import Asset, AssetBody, NameText
from models3d.size_check.category import named_category
from models3d.size_check.check import AssetCheck, check_body

#: Sources that contain these models or their sizes.
MODEL_SOURCES = frozenset({"open_models", "gazebo_models", "sweethome3d", "ycb_hope_dims", "bop_small"})
#: Words in the categories of models with several objects.
SEVERAL = ("stack", "row of", "set", "pair", "cards", "cutlery", "boxes", "books", "logs", "glasses", "tools", "apples",
           "flowers", "tulips", "pillows")  # fmt: skip
#: Factors of simulated unit errors.
UNIT_ERRORS = (1000.0, 100.0, 25.4, 10.0, 3.28, 2.54, 0.394, 0.305, 0.1, 0.0394, 0.01, 0.001)
SEED = 7
#: Half of the categories that is reported.
REPORTED_HALF = 1
#: Edges of the bins of the reliability diagram.
EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0001)


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One model with one error (or none) and the result of its check."""

    error: str
    category: str
    tier: str
    wrong_probability: float
    check: AssetCheck


def main() -> None:
    """Print the tables, or write them."""
    parser = options_parser(__doc__)
    parser.add_argument("models", type=Path)
    parser.add_argument("--raw", type=Path, help="raw items of all sources (default: use the shipped tree)")
    parser.add_argument("--work", type=Path, default=Path("/tmp/assets-tree"), help="folder of the built tree")  # noqa: S108
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    tree = _tree(arguments.raw, arguments.work)
    rows = list(csv.DictReader((arguments.models / "models.csv").open(encoding="utf-8")))
    trials = list(_trials([row for row in rows if _half(row["category"]) == REPORTED_HALF], tree))
    text = "\n".join(_page(trials))
    write_between(arguments.write, "tables", text) if arguments.write else print(text)


def _tree(raw: Path | None, work: Path) -> Tree:
    if raw is None:
        return open_tree()
    if not work.exists():
        files = [
            path
            for path in sorted(raw.glob("*.jsonl*"))
            if not any(word in path.name for word in ("quarantine", "pictures"))
            and path.name.split(".")[0] not in MODEL_SOURCES
        ]
        build_release(files, work, BuildOptions(version="0.0.0", created="2026-11-22", name="assets", heldout=False))
    return open_tree(work)


def _half(category: str) -> int:
    return int(hashlib.sha256(category.encode()).hexdigest(), 16) % 2


def _trials(rows: Iterable[dict[str, str]], tree: Tree) -> Iterator[Trial]:
    generator = np.random.default_rng(SEED)
    for row in rows:
        if any(word in row["category"] for word in SEVERAL):
            continue
        try:
            category = named_category(tree, row["category"])
        except InputError:
            continue
        size = np.array([float(row[f"{axis}_mm"]) for axis in ("length", "height", "width")]) / 1000  # y up
        for error, extents, centred in _errors(size, generator):
            low = -extents / 2 if centred else np.zeros(3)
            body = AssetBody(row["file"], low, low + extents, (NameText("title", row["category"]),))
            check = check_body(row["file"], body, Asset(Path(row["file"]), "glb", 1.0, "y", (body,)), tree, category)
            if check.hypotheses:
                wrong = sum(item.probability for item in check.hypotheses if item.kind not in ("right", "unlike"))
                yield Trial(error, row["category"], check.tier or "not stated", wrong, check)


def _errors(size: FloatArray, generator: np.random.Generator) -> Iterator[tuple[str, FloatArray, bool]]:
    yield "none", size, False
    for factor in UNIT_ERRORS:
        yield f"x {factor:g}", size * factor, False
    yield "unit box", size / size.max(), True
    yield "any scale", size * np.exp(generator.uniform(-6, 6)), False
    yield "turned", size[[0, 2, 1]], False
    stretched = size.copy()
    stretched[generator.integers(3)] *= 3
    yield "one side x 3", stretched, False


def _page(trials: list[Trial]) -> Iterator[str]:
    right = [trial for trial in trials if trial.error == "none"]
    alarms = [trial for trial in right if trial.check.is_wrong]
    kinds = len({t.category for t in right})
    yield f"{len(right)} models, {kinds} categories; called wrong: {len(alarms) / len(right):.1%}"
    yield ""
    yield "| error | not called right | called wrong | the factor within 2 % |"
    yield "|---|---|---|---|"
    groups: dict[str, list[Trial]] = defaultdict(list)
    for trial in trials:
        groups[trial.error].append(trial)
    for error, group in groups.items():
        not_right = _percent(trial.check.verdict != "right" for trial in group)
        exact = ""
        if error.startswith("x "):
            factor = float(error[2:])
            exact = _percent(t.check.factor is not None and abs(t.check.factor * factor - 1) < 0.02 for t in group)
        yield f"| {error} | {not_right} | {_percent(_wrong(group))} | {exact} |"
    yield ""
    yield "| tier | models | right ones called wrong | slips of 10 and more called wrong |"
    yield "|---|---|---|---|"
    for tier in sorted({trial.tier for trial in trials}):
        of_tier = [t for t in right if t.tier == tier]
        large = [t for t in trials if t.tier == tier and t.error.startswith("x ") and not 0.11 < float(t.error[2:]) < 9]
        yield f"| {tier} | {len(of_tier)} | {_percent(_wrong(of_tier))} | {_percent(_wrong(large))} |"
    yield ""
    yield from _reliability(trials)
    yield ""
    names = ", ".join(f"{t.category} ({t.check.verdict})" for t in alarms)
    yield f"Right ones called wrong: {names or 'none'}."


def _reliability(trials: list[Trial]) -> Iterator[str]:
    """Yield the table of the stated probability of a wrong scale against the observed frequency.

    Trials are weighted so that the errors are as frequent as the prior assumes.
    """
    frequency = {
        "none": 0.75,
        **dict.fromkeys((f"x {factor:g}" for factor in UNIT_ERRORS), 0.18 / len(UNIT_ERRORS)),
        "unit box": 0.04,
        "any scale": 0.03,
    }
    yield "| stated probability of a wrong scale | trials | wrong, weighted as the prior assumes |"
    yield "|---|---|---|"
    used = [trial for trial in trials if trial.error in frequency]
    for low, high in pairwise(EDGES):
        inside = [trial for trial in used if low <= trial.wrong_probability < high]
        weights = np.array([frequency[trial.error] for trial in inside])
        wrong = np.array([trial.error != "none" for trial in inside])
        if inside:
            yield f"| {low:.2f} to {min(high, 1):.2f} | {len(inside)} | {(weights * wrong).sum() / weights.sum():.2f} |"


def _wrong(trials: Iterable[Trial]) -> Iterator[bool]:
    return (trial.check.is_wrong for trial in trials)


def _percent(flags: Iterable[bool]) -> str:
    values = list(flags)
    return f"{np.mean(values):.1%}" if values else "-"


if __name__ == "__main__":
    main()
