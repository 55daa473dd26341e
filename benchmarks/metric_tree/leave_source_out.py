"""Priors of an earlier release and of today's fit on the rows of a source that the fit has not seen.

    python -m benchmarks.metric_tree.leave_source_out RAW... [--against 1.0.0] [--work DIR]

A source is left out with all sets that measured the same rooms, and with the published means of such sets. Every leaf
that has rows of it is fitted again, under what the other sources say of kinds and of siblings. Both ways are scored on
the same rows and the same axes: those that the row names, and that both priors have. The earlier release speaks by its
published priors. Of a source that it was built from it has seen the rows, which favours it: the last column says so.

Columns: mean log density over ln mm of a row; share of sizes within the prior's 90 % interval; median over the rows of
|ln(size / the prior's median)|. Each is taken class by class, so that a class counts once; of the densities the median
class is shown, since one class that is another object than its name has a density without a floor, of the others the
mean.
"""

from __future__ import annotations

import argparse
import pickle
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import options_parser
from crawler.imports.declaration import sources
from metric_base.arrays import FloatArray
from metric_base.progress import silent
from metric_cli.tables import print_table
from metric_tree.fit.class_prior import class_prior
from metric_tree.fit.evidence_model import learn_kinds
from metric_tree.fit.moments import moments
from metric_tree.fit.rows import KIND_WEIGHT, STRONG, ClassRows, take_rows
from metric_tree.pipeline.build import BuildOptions, Steps, shipped_curated, shipped_taxonomy
from metric_tree.pipeline.clean import Cleaned, NodeClass
from metric_tree.pipeline.hierarchy import Hierarchy, kept_categories
from metric_tree.pipeline.ingest import block_of, blocks, raw_files
from metric_tree.pipeline.work_folder import BuildFolder
from metric_tree.prior import Prior
from metric_tree.tree import Tree, open_tree
from taxonomy.levels import replaced_ids

#: Rows of a source in a class that are scored, and the classes of a source that make it worth a line.
MOST_ROWS, LEAST_ROWS, LEAST_CLASSES = 60, 5, 2

WORKERS, SEED = 2, 0

#: Means that others published of the boxes of the sets that are left out.
MEANS = "published_class_means"


def clean_rows(raw: Sequence[Path], work: Path) -> None:
    """Ingest and clean the rows of a build in a work folder, unless they are there."""
    if list(work.glob("clean-*.classes")):
        return
    work.mkdir(parents=True, exist_ok=True)
    declared = {source.id: source for source in sources()}
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        options = BuildOptions(version="0.0.0", created="")
        steps = Steps(options, shipped_taxonomy, declared, None, pool, silent, BuildFolder(work))
        steps.ingest([*blocks(raw_files(raw)), block_of(shipped_curated(), "curated ranges")])
        steps.clean()


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """All classes of a build: the rows of each, what it made of them, and the tree of the kept categories."""

    rows: Mapping[str, ClassRows]
    classes: Mapping[str, NodeClass]
    hierarchy: Hierarchy

    @classmethod
    def of(cls, options: argparse.Namespace) -> Rows:
        """The cleaned rows that the options of `rows_parser` name, from the work folder if they are there."""
        work = options.work or Path(tempfile.mkdtemp())
        clean_rows(options.raw, work)
        cleaned: list[Cleaned] = [_unpickled(path) for path in sorted(work.glob("clean-*.pickle"))]
        classes = {one.node_id: one for part in cleaned for one in part.classes}
        rows = {one.node_id: one for path in sorted(work.glob("clean-*.classes")) for one in _unpickled(path)}
        return cls(rows, classes, Hierarchy.of(kept_categories(shipped_taxonomy().categories(), classes)))

    def without(self, source: str) -> Iterator[tuple[ClassRows, Prior]]:
        """Each class that the source has rows of, with its prior from all others' rows."""
        families = self.hierarchy.families()
        seen: dict[str, ClassRows] = {}
        known = {node_id: list(one.moments) for node_id, one in self.classes.items()}
        for node_id, rows in self.rows.items():
            kept = np.flatnonzero(~np.isin(rows.sources, (source, MEANS)))
            if len(kept) < len(rows.sources):
                if len(kept):
                    seen[node_id] = replace(take_rows(rows, kept), n=len(kept))
                    known[node_id][0] = moments(seen[node_id])
                else:
                    del known[node_id]
        first = (own[0] for own in known.values())
        pairs = ((families[one.node_id], one.disagreement) for one in first)
        model = learn_kinds(((family, one) for family, one in pairs if one is not None), sorted(KIND_WEIGHT))
        beliefs = self.hierarchy.beliefs(one for own in known.values() for one in own)
        parents = {category.node_id: category.parent_id or "" for category in self.hierarchy.categories}
        for node_id, own in seen.items():
            belief = beliefs[parents[node_id], own.axes]
            if source in self.rows[node_id].sources:
                yield self.rows[node_id], class_prior(own, belief, model, families[node_id], heldout=False)


@dataclass(frozen=True, slots=True)
class Score:
    """Of one class under one prior: log density of a row, share of sizes inside, median |ln(size / median)|."""

    density: float
    inside: float
    error: float

    @classmethod
    def of(cls, prior: Prior, sizes: FloatArray) -> Score:
        """The score of sizes (n, d) in mm on all axes of the prior."""
        low, high = prior.interval(0.9).T
        inside = (sizes >= low) & (sizes <= high)
        error = np.abs(np.log(sizes / prior.quantile(0.5)))
        return cls(float(prior.log_density(sizes).mean()), float(inside.mean()), float(np.median(error)))


def held_rows(rows: ClassRows, source: str) -> FloatArray:
    """Sizes (n, 3) in mm of the source's rows whose axes are known, NaN where unstated; few of many."""
    readings = np.bincount(rows.owner, minlength=len(rows.sources))
    own = np.flatnonzero((np.asarray(rows.sources) == source) & (readings == 1))
    own = np.random.default_rng(SEED).permutation(own)[:MOST_ROWS]
    return np.asarray(np.exp(rows.x[np.searchsorted(rows.owner, own)]))


def stated_parts(rows: ClassRows, prior: Prior, source: str) -> Iterator[tuple[tuple[str, ...], FloatArray]]:
    """Axes of the prior that rows of the source state together, and sizes (n, d) in mm; only of enough rows."""
    sizes = held_rows(rows, source)
    stated = ~np.isnan(sizes)
    for pattern in np.unique(stated, axis=0) if len(sizes) else ():
        dims = tuple(axis for axis, has in zip(rows.axes, pattern, strict=True) if has and axis in prior.dims)
        chosen = sizes[(stated == pattern).all(axis=1)][:, [rows.axes.index(axis) for axis in dims]]
        if dims and len(chosen) >= LEAST_ROWS:
            yield dims, chosen


def rows_parser(description: str | None) -> argparse.ArgumentParser:
    """The options that say where the rows of a build are (`Rows.stated`)."""
    parser = options_parser(description)
    parser.add_argument("raw", nargs="+", type=Path)
    parser.add_argument("--work", type=Path, help="folder of the cleaned rows; taken up if they are there")
    return parser


def prior_of(tree: Tree, node_id: str, dims: tuple[str, ...]) -> Prior | None:
    """The earlier tree's prior of a class over some axes; None if the tree has not the class, or not the axes."""
    former = [old for old, new in replaced_ids().items() if new == node_id]
    known = next((one for one in (node_id, *former) if tree.has_node(one)), None)
    if known is None or not any(set(dims) <= set(have) for have in tree.prior_dims(known)):
        return None
    return tree.node(known).prior(dims)


def scores(build: Rows, tree: Tree, source: str) -> Iterator[tuple[str, Score, Score]]:
    """Class, score of the earlier tree, score of today's fit without the source."""
    for rows, prior in build.without(source):
        for dims, chosen in stated_parts(rows, prior, source):
            before = prior_of(tree, rows.node_id, dims)
            if before is not None:
                yield rows.node_id, Score.of(before, chosen), Score.of(prior.marginal(dims), chosen)


def left_out(build: Rows) -> list[str]:
    """Sources with enough rows of real objects in enough classes."""
    counts: dict[str, int] = {}
    for rows in build.rows.values():
        kinds = np.asarray(rows.kinds)
        names, number = np.unique(np.asarray(rows.sources)[np.isin(kinds, sorted(STRONG))], return_counts=True)
        for name, rows_of_it in zip(names.tolist(), number.tolist(), strict=True):
            counts[name] = counts.get(name, 0) + (rows_of_it >= LEAST_ROWS)
    return sorted(name for name, classes in counts.items() if classes >= LEAST_CLASSES)


def _unpickled(path: Path) -> Any:
    return pickle.loads(path.read_bytes())  # noqa: S301 - written by this very program


def _pairs(before: Sequence[Score], after: Sequence[Score]) -> FloatArray:
    """Median density, mean share inside and mean error before and after, (3, 2)."""
    table = np.array([[(one.density, one.inside, one.error) for one in own] for own in (before, after)])  # (2, n, 3)
    return np.column_stack([np.median(table[..., 0], axis=1), table[..., 1:].mean(axis=1)]).T


def main() -> None:
    """Print a line for each source, and the mean over the classes of the sources that the earlier release lacks."""
    parser = rows_parser(__doc__)
    parser.add_argument("--against", default="1.0.0", help="version or folder of the earlier release")
    parser.add_argument("--only-new", action="store_true", help="sources that the earlier release lacks, and no others")
    arguments = parser.parse_args()
    tree = open_tree(arguments.against)
    build = Rows.of(arguments)
    # sets of the same rooms are one, under the rooms' name: no declared source, and none of them is new
    seen = {record["id"] for record in tree.release.manifest["sources"]}
    new = {source.id for source in sources()} - seen
    lines, fresh = [], []
    for source in left_out(build):
        if arguments.only_new and source not in new:
            continue
        own = list(scores(build, tree, source))
        if len({node_id for node_id, *_ in own}) < LEAST_CLASSES:
            continue
        fresh += own if source in new else []
        lines.append(_line(source, own, source not in new))
    lines.append(_line(f"all that {tree.version} lacks", fresh, False))
    ways = [f"{name} {way}" for name in ("density", "inside", "error") for way in (tree.version, "today")]
    print_table(["left out", "classes", *ways, f"{tree.version} saw the rows"], lines)


def _line(name: str, own: Sequence[tuple[str, Score, Score]], seen: bool) -> tuple[str, ...]:
    pairs = _pairs([one for _, one, _ in own], [one for _, _, one in own])
    cells = [f"{value:.2f}" for both in pairs for value in both]
    return (name, str(len({node_id for node_id, *_ in own})), *cells, "yes" if seen else "")


if __name__ == "__main__":
    main()
