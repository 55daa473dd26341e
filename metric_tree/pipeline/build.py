"""Raw items to a release, in five steps that an interruption may part (`metric-tree build`).

1. ingest: blocks of lines to Arrow rows, matched to a leaf and mapped to axes, parted into shards by node;
2. clean: per shard, repeats and unit slips out, moments of each class;
3. pool: how sources disagree over all classes; what each inner node believes of its children;
4. fit: per shard, the prior of each leaf; then the inner nodes, from the leaves up;
5. publish: four tables and a manifest, written aside and renamed.

Steps 1, 2 and 4 are pure functions over an executor: this process, processes, or a Dask cluster. What they return is
kept in a work folder until the release is published. The same input gives the same release to the byte, whatever the
executor; the caller gives the date.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa

from crawler.imports.declaration import Source, sources
from crawler.items import RawItem
from metric_base.errors import InputError
from metric_base.progress import ProgressCallback, silent
from metric_tree.context import ContextModel
from metric_tree.curated.rules import stated_frequencies
from metric_tree.fit.class_prior import shrunk_between
from metric_tree.fit.contexts import class_contexts, learn_contexts
from metric_tree.fit.evidence_model import KindModel, learn_kinds
from metric_tree.fit.rows import KIND_WEIGHT
from metric_tree.pipeline.build_report import report
from metric_tree.pipeline.clean import Cleaned, NodeClass, class_priors, clean_shard
from metric_tree.pipeline.companion_files import (
    add_pictures,
    height_records,
    state_records,
    write_log,
    write_texts,
    writers,
)
from metric_tree.pipeline.hierarchy import Hierarchy, kept_categories
from metric_tree.pipeline.ingest import SHARDS, Block, Ingested, block_of, blocks, ingest_block, items_of, raw_files
from metric_tree.pipeline.tables import (
    JUDGED_SOURCE,
    NORM_SOURCE,
    evidence_counts,
    node_counts,
    node_table,
    prior_table,
    source_records,
    tier_counts,
)
from metric_tree.pipeline.work_folder import (
    BuildFolder,
    RowFiles,
    SerialExecutor,
    fingerprint,
    sibling_references,
    sole_writer,
)
from metric_tree.prior import Prior
from metric_tree.release.release import Release, publish_release
from metric_tree.release.schema import IMAGES
from taxonomy.categories import Taxonomy

_R = TypeVar("_R")

#: Licence of rows and images that nobody gave on: their site's own terms hold, and the release stays at home.
PRIVATE_LICENCE = "none: own use only"

#: What the manifest states of priors that were not fitted here.
CARRIED = "nodes and priors, fitted with sources whose rows are withheld; the rows were made from the raw items"


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildOptions:
    """What a release is called and what it leaves out.

    created : ISO date of the release; fold_out : fold I of N of the items that the build does not see;
    noncommercial : whether sources that exclude commercial use take part; heldout : whether priors are scored;
    private : sources without an open licence whose rows and images are kept all the same, for the builder's own use;
    images : whether images beside the raw items are taken.
    """

    version: str
    created: str
    name: str = "metric-tree"
    fold_out: tuple[int, int] | None = None
    noncommercial: bool = True
    private: tuple[str, ...] = ()
    heldout: bool = True
    pictures: bool = True
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Build:
    """A published release, what a maintainer should read (counts by reason, disagreements, mixed classes), the log."""

    release: Release
    report: Mapping[str, Any]
    log: Path


def shipped_taxonomy() -> Taxonomy:
    """The taxonomy of the package."""
    import taxonomy  # WordNet is read where it is needed

    default: Callable[[], Taxonomy] = taxonomy.default_taxonomy
    return default()


def shipped_curated() -> Iterable[RawItem]:
    """The package's norms, which fix a class, and its judged ranges, which speak where a class has few items."""
    from metric_tree.curated.sizes import judged_items, norm_items

    return (*norm_items(), *judged_items())


def build_release(
    raw: Sequence[Path],
    out: Path,
    options: BuildOptions,
    *,
    log: Path | None = None,
    taxonomy: Callable[[], Taxonomy] = shipped_taxonomy,
    curated: Iterable[RawItem] = (),
    declared: Mapping[str, Source] | None = None,
    carried: Release | None = None,
    executor: Executor | None = None,
    progress: ProgressCallback = silent,
) -> Build:
    """Build a release at `out` from raw items; the log folder gets `quarantine.jsonl` and `report.json`.

    Parameters
    ----------
    raw : files or folders of raw items, with the images of a crawl beside them; log : `<out>.build` by default
    taxonomy : a function at the top of a module, so that a worker can call it
    curated : raw items of the kinds `norm` and `judged`
    declared : sources by id, those of `data/sources` by default; rows of others are used and not shipped
    carried : a release whose choice of rows, nodes and priors holds, where `raw` lacks sources that it was fitted with:
        the rows are made again, and are the same to the byte
    executor : where the steps run, this process by default
    progress : is called with the name of a step, how many of its parts are done, and of how many or None

    Raises
    ------
    InputError
        Something is at `out` already or another process is writing it, there are no raw items, a line is none, or no
        item is of a private source.

    Examples
    --------
    >>> import metric_tree, tempfile
    >>> from pathlib import Path
    >>> options = metric_tree.BuildOptions(version="0.1.0", created="2026-01-01", heldout=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     build = metric_tree.build_release([Path("data/raw/paper_sizes.jsonl.gz")], Path(folder) / "mine", options)
    >>> build.release.manifest["counts"]["leaves"] > 0
    True
    """
    if out.exists():
        raise InputError(f"{out}: already exists; expected a new path for a release")
    files = raw_files(raw)
    declared = {source.id: source for source in sources()} if declared is None else declared
    _expect_private(options.private, files)
    own = block_of(curated, "curated ranges")
    log = log or out.with_name(f"{out.name}.build")
    key = fingerprint(files, repr((options, sorted(declared.items()), own, carried)))
    with sole_writer(out), _empty_after_an_error(log), BuildFolder.open(log / "work", key) as work:
        steps = Steps(options, taxonomy, declared, carried, executor or SerialExecutor(), progress, work)
        counts = steps.ingest(chain(blocks(files), [own]))
        classes, dropped = steps.clean()
        report, tables, manifest = (steps.carry if carried else steps.fit)(classes, counts + dropped)
        extras = work.directory / "extras"
        extras.mkdir(exist_ok=True)
        if options.pictures:
            add_pictures(raw, tables, report, extras)
        write_texts(extras, tables, manifest, former=taxonomy is shipped_taxonomy)
        write_log(log, work.directory, report)  # first, since a run that finds the release there writes no log
        release = publish_release(out, tables, manifest, extras)
    return Build(release, report, log)


@contextmanager
def _empty_after_an_error(log: Path) -> Iterator[None]:
    """Remove the log's folder, if the input is invalid and nothing was logged."""
    try:
        yield
    except InputError:
        with suppress(OSError):  # an earlier build's log is in it
            log.rmdir()
        raise


def _expect_private(private: Sequence[str], files: Iterable[Path]) -> None:
    """See that every source to be kept private has raw items: one that is misspelt would be withheld without a word."""
    present: set[str] = set()
    for block in blocks(files) if private else ():
        if set(private) <= present:  # a large folder need not be read to its end
            return
        present |= {item.source for item in items_of(block)}
    missing = sorted(set(private) - present)
    if missing:
        known = ", ".join(sorted(present)) or "none"
        raise InputError(f"--include-withheld: expected sources of the raw items ({known}); found {', '.join(missing)}")


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """The steps of one build, each over an executor, its results in a work folder."""

    options: BuildOptions
    taxonomy: Callable[[], Taxonomy]
    declared: Mapping[str, Source]
    carried: Release | None
    executor: Executor
    progress: ProgressCallback
    work: BuildFolder

    def ingest(self, lines: Iterable[Block]) -> Counter[str]:
        """Step 1; the rows lie in the work folder. Counts of raw items by outcome."""
        noncommercial = (name for name, source in self.declared.items() if source.noncommercial)
        left_out = frozenset() if self.options.noncommercial else frozenset(noncommercial)
        calls = ((block, self.taxonomy, self.options.fold_out, left_out) for block in lines)
        counts: Counter[str] = Counter()
        for result in self._map("ingest", ingest_block, calls, _spill_rows):
            counts += result.counts
        return counts

    def clean(self) -> tuple[list[NodeClass], Counter[str]]:
        """Step 2: the classes, without their rows, and the rows dropped by reason."""
        rows = RowFiles(tuple(sorted(self.work.directory.glob("ingest-*.arrow"))))
        repeated, siblings = rows.repeats(), sibling_references(rows, self.taxonomy().categories())
        licences = {
            source.id: source.licence for source in (*self.declared.values(), JUDGED_SOURCE, NORM_SOURCE) if source.ship
        }
        licences |= dict.fromkeys(self.options.private, PRIVATE_LICENCE)
        ids = frozenset(self.carried.table("items")["item_id"].to_pylist()) if self.carried else None
        calls = ((rows.shard(number, repeated), licences, siblings, ids) for number in range(SHARDS))
        classes: list[NodeClass] = []
        counts = Counter({"repeated_id": len(repeated.extra)})
        for result in self._map("clean", clean_shard, calls, _spill_classes):
            classes += result.classes
            counts += result.counts
        return classes, counts

    def fit(
        self, classes: Sequence[NodeClass], counts: Counter[str]
    ) -> tuple[dict[str, Any], dict[str, pa.Table], dict[str, Any]]:
        """Steps 3 and 4: what a maintainer should read, the tables and the manifest."""
        by_id = {one.node_id: one for one in classes}
        hierarchy = Hierarchy.of(kept_categories(self.taxonomy().categories(), by_id))
        families = hierarchy.families()
        model = _learn_kinds(classes, families)
        contexts = _learn_contexts(classes, families, model)
        leaves = self._leaves(classes, hierarchy, families, model)
        priors = hierarchy.priors(leaves, by_id, stated_frequencies())
        tables = {
            "nodes.parquet": node_table(hierarchy, by_id, priors),
            "items.parquet": self._items(),
            "priors.parquet": prior_table(hierarchy, hierarchy.with_sameness(priors, by_id)),
            "images.parquet": IMAGES.empty_table(),
        }
        manifest = self._manifest(tables, classes, counts)
        manifest |= {"evidence_model": model.record(), "context_model": contexts.record()}
        return report(classes, leaves, model, counts, hierarchy.categories, tables["items.parquet"]), tables, manifest

    def carry(
        self, classes: Sequence[NodeClass], counts: Counter[str]
    ) -> tuple[dict[str, Any], dict[str, pa.Table], dict[str, Any]]:
        """In place of `fit`: the rows of this build under the nodes and priors of the release that is carried over."""
        if self.carried is None:
            raise ValueError("carried: expected a release; found none")
        tables = {f"{name}.parquet": self.carried.table(name) for name in ("nodes", "priors", "images")}
        tables["items.parquet"] = self._items()
        manifest = {**self.carried.manifest, "carried": {"version": self.carried.manifest["version"], "what": CARRIED}}
        n_rows = Counter(tables["items.parquet"]["source"].to_pylist())
        manifest["sources"] = [record | {"n_rows": n_rows[record["id"]]} for record in manifest["sources"]]
        manifest["counts"] = manifest["counts"] | {"n_rows": tables["items.parquet"].num_rows}
        manifest |= {name: getattr(self.options, name) for name in ("name", "version", "created")}
        return {"raw": dict(sorted(counts.items())), "classes": len(classes)}, tables, manifest

    def _leaves(
        self, classes: Sequence[NodeClass], hierarchy: Hierarchy, families: Mapping[str, str], model: KindModel
    ) -> dict[str, Prior]:
        parents = {category.node_id: category.parent_id or "" for category in hierarchy.categories}
        beliefs = hierarchy.beliefs(m for one in classes for m in one.moments)
        own = {one.node_id: beliefs[parents[one.node_id], one.moments[0].axes] for one in classes}
        files = sorted(self.work.directory.glob("clean-*.classes"))
        options = self.options
        calls = ((path.read_bytes(), own, families, model, options.seed, options.heldout) for path in files)
        fitted = {prior.node_id: prior for priors in self._map("fit", class_priors, calls) for prior in priors}
        return {
            one.node_id: replace(fitted[one.node_id], norm=one.norm)
            if one.norm
            else class_contexts(fitted[one.node_id], one.moments[0].axes, one.cells, np.diagonal(one.moments[0].within))
            for one in classes
        }

    def _items(self) -> pa.Table:
        """The shipped items, mapped from the work folder and not read into memory."""
        files = sorted(self.work.directory.glob("clean-*.items"))
        return pa.concat_tables([pa.ipc.open_file(pa.memory_map(str(path))).read_all() for path in files])

    def _manifest(
        self, tables: Mapping[str, pa.Table], classes: Sequence[NodeClass], counts: Counter[str]
    ) -> dict[str, Any]:
        n_fit: Counter[str] = Counter()
        for one in classes:
            n_fit.update(one.n_by_source)
        n_rows = Counter(tables["items.parquet"]["source"].to_pylist())
        used = frozenset().union(*(one.kinds for one in classes))
        nodes = frozenset(tables["nodes.parquet"]["node_id"].to_pylist())
        return {
            "name": self.options.name,
            "version": self.options.version,
            "created": self.options.created,
            "sources": source_records(self.declared, n_fit, n_rows, used),
            "counts": node_counts(tables["nodes.parquet"])
            | {"n_fit": n_fit.total(), "n_rows": tables["items.parquet"].num_rows, "raw": dict(sorted(counts.items()))},
            "evidence": evidence_counts(classes),
            "tiers": tier_counts(tables["nodes.parquet"]),
            "judged_by": writers(),
            "states": state_records(nodes),
            "heights": height_records(nodes),
            "noncommercial": self.options.noncommercial,
            "private": sorted(self.options.private),
            "fold_out": list(self.options.fold_out) if self.options.fold_out else None,
        }

    def _map(
        self,
        step: str,
        function: Callable[..., _R],
        calls: Iterable[Any],
        spilled: Callable[[_R, Path], _R] | None = None,
    ) -> Iterator[_R]:
        for done, result in enumerate(self.work.map(step, function, calls, self.executor, spilled), start=1):
            # the blocks of the first step are not counted ahead
            self.progress(step, done, None if step == "ingest" else SHARDS)
            yield result


def _learn_kinds(classes: Sequence[NodeClass], families: Mapping[str, str]) -> KindModel:
    """What kinds of evidence are worth, from the classes that have several."""
    pairs = ((families[one.node_id], m.disagreement) for one in classes for m in one.moments[:1])
    return learn_kinds(((family, one) for family, one in pairs if one is not None), sorted(KIND_WEIGHT))


def _learn_contexts(classes: Sequence[NodeClass], families: Mapping[str, str], model: KindModel) -> ContextModel:
    """How much of the disagreement between sources is region and year, from the classes that have several."""
    known = ((one, one.moments[0].disagreement) for one in classes if one.cells)
    return learn_contexts(
        (one.cells, np.diagonal(own.within), np.diagonal(shrunk_between(own, model, families[one.node_id])))
        for one, own in known
        if own is not None
    )


def _spill_rows(result: Ingested, stem: Path) -> Ingested:
    stem.with_suffix(".arrow").write_bytes(result.rows)
    stem.with_suffix(".refused").write_bytes(result.refused)
    return replace(result, rows=b"", refused=b"")


def _spill_classes(result: Cleaned, stem: Path) -> Cleaned:
    stem.with_suffix(".items").write_bytes(result.items)
    stem.with_suffix(".refused").write_bytes(result.refused)
    stem.with_suffix(".classes").write_bytes(result.rows)
    return replace(result, items=b"", refused=b"", rows=b"")
