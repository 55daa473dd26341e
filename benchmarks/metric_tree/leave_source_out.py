"""Compare the priors of an earlier release with the current fit on the rows of a held-out source.

    python -m benchmarks.metric_tree.leave_source_out RAW... [--against 1.0.0] [--work DIR]

A source is held out together with all data sets of the same rooms and with the published means of such sets. Every leaf
with rows of the source is fitted again, with evidence kinds and siblings learned from the other sources. Both priors
are scored on the same rows and axes: the ones that the row states and both priors have. The earlier release is
evaluated with its published priors. If it was built from the held-out source, its score is too good; the last column
marks these sources.

Columns: mean log density of a row over ln mm; fraction of sizes within the prior's 90 % interval; median over the rows
of |ln(size / the prior's median)|. Statistics are computed per class, so that classes have equal weight. The median
over the classes is printed for the density, which is unbounded below for a mislabelled class, and the mean for the
others.
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
from metric_tree.fit.evidence_model import fit_evidence_model
from metric_tree.fit.moments import moments
from metric_tree.fit.rows import KIND_WEIGHT, STRONG, ClassRows, take_rows
from metric_tree.pipeline.build import BuildOptions, BuildRun, clean, ingest, shipped_curated, shipped_taxonomy
from metric_tree.pipeline.clean import NodeClass, ShardClasses
from metric_tree.pipeline.hierarchy import Hierarchy, categories_with_items
from metric_tree.pipeline.ingest import raw_files
from metric_tree.pipeline.work_folder import BuildFolder
from metric_tree.prior import Prior
from metric_tree.tree import Tree, open_tree
from taxonomy.levels import replaced_ids

#: Maximum number of scored rows of a source in a class.
MAX_ROWS = 60
#: Minimum number of rows of a source in a class.
MIN_ROWS = 5
#: Minimum number of classes of a source.
MIN_CLASSES = 2

WORKERS = 2
SEED = 0

#: Source with published means of the boxes of held-out data sets.
MEANS = "published_class_means"


def clean_rows(raw: Sequence[Path], work: Path) -> None:
    """Ingest and clean the rows of a build in a work folder, unless the folder contains them."""
    if list(work.glob("classes-*.classes")):
        return
    work.mkdir(parents=True, exist_ok=True)
    declared = {source.id: source for source in sources()}
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        options = BuildOptions(version="0.0.0", created="")
        run = BuildRun(options, shipped_taxonomy, declared, None, pool, silent, BuildFolder(work))
        counts = ingest(run, raw_files(raw), "".join(f"{item.line()}\n" for item in shipped_curated()))
        clean(run, counts["taken"])


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Classes of a build: their rows, their statistics, and the tree of the remaining categories."""

    rows: Mapping[str, ClassRows]
    classes: Mapping[str, NodeClass]
    hierarchy: Hierarchy

    @classmethod
    def of(cls, options: argparse.Namespace) -> Rows:
        """Return the cleaned rows for options of `rows_parser`, from the work folder if it contains them."""
        work = options.work or Path(tempfile.mkdtemp())
        clean_rows(options.raw, work)
        cleaned: list[ShardClasses] = [_unpickled(path) for path in sorted(work.glob("classes-*.pickle"))]
        classes = {item.node_id: item for part in cleaned for item in part.classes}
        rows = {item.node_id: item for path in sorted(work.glob("classes-*.classes")) for item in _unpickled(path)}
        return cls(rows, classes, Hierarchy.of(categories_with_items(shipped_taxonomy().categories(), classes)))

    def without(self, source: str) -> Iterator[tuple[ClassRows, Prior]]:
        """Yield each class with rows of the source, and its prior from the rows of the other sources."""
        families = self.hierarchy.families()
        reduced: dict[str, ClassRows] = {}
        known = {node_id: list(item.all_moments) for node_id, item in self.classes.items()}
        for node_id, rows in self.rows.items():
            kept = np.flatnonzero(~np.isin(rows.sources, (source, MEANS)))
            if len(kept) < len(rows.sources):
                if len(kept):
                    reduced[node_id] = replace(take_rows(rows, kept), n=len(kept))
                    known[node_id][0] = moments(reduced[node_id])
                else:
                    del known[node_id]
        first = (class_moments[0] for class_moments in known.values())
        pairs = ((families[item.node_id], item.by_source) for item in first)
        model = fit_evidence_model(
            ((family, value) for family, value in pairs if value is not None), sorted(KIND_WEIGHT)
        )
        beliefs = self.hierarchy.beliefs(item for class_moments in known.values() for item in class_moments)
        parents = {category.node_id: category.parent_id or "" for category in self.hierarchy.categories}
        for node_id, rows in reduced.items():
            belief = beliefs[parents[node_id], rows.axes]
            if source in self.rows[node_id].sources:
                yield self.rows[node_id], class_prior(rows, belief, model, families[node_id], heldout=False)


@dataclass(frozen=True, slots=True)
class Score:
    """Score of a prior on one class: mean log density, fraction of sizes inside, median |ln(size / median)|."""

    density: float
    inside: float
    error: float

    @classmethod
    def of(cls, prior: Prior, sizes: FloatArray) -> Score:
        """Score sizes (n, d) in mm on all axes of the prior."""
        low, high = prior.interval(0.9).T
        inside = (sizes >= low) & (sizes <= high)
        error = np.abs(np.log(sizes / prior.quantile(0.5)))
        return cls(float(prior.log_density(sizes).mean()), float(inside.mean()), float(np.median(error)))


def held_rows(rows: ClassRows, source: str) -> FloatArray:
    """Return up to `MAX_ROWS` random sizes (n, 3) in mm of the source's rows with known axes; NaN if not stated."""
    readings = np.bincount(rows.owner, minlength=len(rows.sources))
    indices = np.flatnonzero((np.asarray(rows.sources) == source) & (readings == 1))
    indices = np.random.default_rng(SEED).permutation(indices)[:MAX_ROWS]
    return np.asarray(np.exp(rows.x[np.searchsorted(rows.owner, indices)]))


def stated_parts(rows: ClassRows, prior: Prior, source: str) -> Iterator[tuple[tuple[str, ...], FloatArray]]:
    """Yield groups of at least `MIN_ROWS` rows that state the same axes of the prior: axes, and sizes (n, d) in mm."""
    sizes = held_rows(rows, source)
    stated = ~np.isnan(sizes)
    for pattern in np.unique(stated, axis=0) if len(sizes) else ():
        dims = tuple(axis for axis, has in zip(rows.axes, pattern, strict=True) if has and axis in prior.dims)
        chosen = sizes[(stated == pattern).all(axis=1)][:, [rows.axes.index(axis) for axis in dims]]
        if dims and len(chosen) >= MIN_ROWS:
            yield dims, chosen


def rows_parser(description: str | None) -> argparse.ArgumentParser:
    """Return a parser with the options of `Rows.of`."""
    parser = options_parser(description)
    parser.add_argument("raw", nargs="+", type=Path)
    parser.add_argument("--work", type=Path, help="folder of the cleaned rows, which are reused if it contains them")
    return parser


def prior_of(tree: Tree, node_id: str, dims: tuple[str, ...]) -> Prior | None:
    """Return the earlier tree's prior of a class over some axes, or None if it has no such class or axes."""
    former = [old for old, new in replaced_ids().items() if new == node_id]
    known = next((other for other in (node_id, *former) if tree.has_node(other)), None)
    if known is None or not any(set(dims) <= set(have) for have in tree.prior_dims(known)):
        return None
    return tree.node(known).prior(dims)


def scores(build: Rows, tree: Tree, source: str) -> Iterator[tuple[str, Score, Score]]:
    """Yield class, score of the earlier tree, and score of the current fit without the source."""
    for rows, prior in build.without(source):
        for dims, chosen in stated_parts(rows, prior, source):
            before = prior_of(tree, rows.node_id, dims)
            if before is not None:
                yield rows.node_id, Score.of(before, chosen), Score.of(prior.marginal(dims), chosen)


def scored_sources(build: Rows) -> list[str]:
    """Return the sources with at least `MIN_ROWS` rows of real objects in at least `MIN_CLASSES` classes."""
    counts: dict[str, int] = {}
    for rows in build.rows.values():
        kinds = np.asarray(rows.kinds)
        names, row_counts = np.unique(np.asarray(rows.sources)[np.isin(kinds, sorted(STRONG))], return_counts=True)
        for name, count in zip(names.tolist(), row_counts.tolist(), strict=True):
            counts[name] = counts.get(name, 0) + (count >= MIN_ROWS)
    return sorted(name for name, classes in counts.items() if classes >= MIN_CLASSES)


def _unpickled(path: Path) -> Any:
    return pickle.loads(path.read_bytes())  # noqa: S301 - written by this program


def main() -> None:
    """Print a line for each source, and a line for all sources that the earlier release does not have."""
    parser = rows_parser(__doc__)
    parser.add_argument("--against", default="1.0.0", help="version or folder of the earlier release")
    parser.add_argument("--only-new", action="store_true", help="only sources that the earlier release does not have")
    arguments = parser.parse_args()
    tree = open_tree(arguments.against)
    build = Rows.of(arguments)
    # data sets of the same rooms are merged under a name that is not a declared source, so they are not new
    former = {record["id"] for record in tree.release.manifest["sources"]}
    new = {source.id for source in sources()} - former
    lines: list[tuple[str, ...]] = []
    new_scores: list[tuple[str, Score, Score]] = []
    for source in scored_sources(build):
        if arguments.only_new and source not in new:
            continue
        source_scores = list(scores(build, tree, source))
        if len({node_id for node_id, *_ in source_scores}) < MIN_CLASSES:
            continue
        new_scores += source_scores if source in new else []
        lines.append(_line(source, source_scores, source not in new))
    lines.append(_line(f"all that {tree.version} lacks", new_scores, False))
    columns = [f"{name} {release}" for name in ("density", "inside", "error") for release in (tree.version, "today")]
    print_table(["left out", "classes", *columns, f"{tree.version} saw the rows"], lines)


def _line(name: str, rows: Sequence[tuple[str, Score, Score]], seen: bool) -> tuple[str, ...]:
    """Return the row of a source: median density, mean fraction inside and mean error of both releases."""
    before, after = [score for _, score, _ in rows], [score for _, _, score in rows]
    table = np.array([[(s.density, s.inside, s.error) for s in column] for column in (before, after)])  # (2, n, 3)
    pairs = np.column_stack([np.median(table[..., 0], axis=1), table[..., 1:].mean(axis=1)]).T
    cells = [f"{value:.2f}" for pair in pairs for value in pair]
    return (name, str(len({node_id for node_id, *_ in rows})), *cells, "yes" if seen else "")


if __name__ == "__main__":
    main()
