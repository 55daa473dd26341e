"""Build of a release from raw items in five steps, which can be interrupted (`metric-tree build`).

1. ingest: convert blocks of lines to Arrow rows, match each to a leaf, assign its sizes to axes, divide by node;
2. clean: remove repeats and unit errors from units of bounded size, compute the moments of each class;
3. pool: model of the kinds of evidence and model of regions and years, over all classes;
4. fit: the prior of each leaf, then the priors of the inner nodes from the leaves up;
5. publish: four tables and a manifest, written to a temporary folder and renamed.

Steps 1, 2 and 4 are pure functions over an executor: this process, processes, or a Dask cluster. A work folder stores
their results until the release is published. The same input gives the same bytes with any executor; the caller provides
the date.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa

from crawler.imports.declaration import Source, sources
from crawler.items import RawItem, raw_items
from metric_base.errors import InputError
from metric_base.files import sole_writer
from metric_base.progress import ProgressCallback, silent
from metric_base.remote import url_of
from metric_tree.context import ContextModel
from metric_tree.curated.rules import stated_frequencies
from metric_tree.fit.class_prior import shrunk_between
from metric_tree.fit.contexts import class_contexts, fit_context_model
from metric_tree.fit.evidence_model import EvidenceModel, fit_evidence_model
from metric_tree.fit.rows import KIND_WEIGHT
from metric_tree.pipeline.build_report import build_report
from metric_tree.pipeline.clean import NodeClass, class_priors, clean_unit, shard_classes
from metric_tree.pipeline.companion_files import (
    add_images,
    height_records,
    state_records,
    write_log,
    write_texts,
    writers,
)
from metric_tree.pipeline.hierarchy import Hierarchy, categories_with_items
from metric_tree.pipeline.ingest import SHARDS, Block, blocks, ingest_block, raw_files, unpack
from metric_tree.pipeline.shards import MAX_PARTITION_ROWS, repeated_rows, shard_sizes, sibling_references, units
from metric_tree.pipeline.tables import (
    PROJECT_SOURCES,
    evidence_counts,
    node_counts,
    node_table,
    prior_table,
    source_records,
    tier_counts,
)
from metric_tree.pipeline.work_folder import BuildFolder, SerialExecutor, fingerprint
from metric_tree.prior import Prior
from metric_tree.release.release import Release, publish_release
from metric_tree.release.schema import IMAGES
from metric_tree.release.terms import basis
from taxonomy.categories import Taxonomy

_R = TypeVar("_R")

#: Licence of rows and images without an open licence: the terms of their site apply, and the release is not
#: redistributed.
PRIVATE_LICENCE = "none: own use only"

#: Entry of the manifest for priors that were not fitted in this build.
CARRIED = "nodes and priors, fitted with sources whose rows are withheld; the rows were made from the raw items"


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildOptions:
    """Name of a release, and the raw items that it omits."""

    version: str
    created: str  #: ISO date of the release.
    name: str = "metric-tree"
    fold_out: tuple[int, int] | None = None  #: (I, N): fold I of N of the items is omitted.
    noncommercial: bool = True  #: Whether sources that exclude commercial use are used.
    private: tuple[str, ...] = ()  #: Sources without an open licence whose rows and images are kept for private use.
    heldout: bool = True  #: Whether the held-out log density of each prior is computed.
    pictures: bool = True  #: Whether the images next to the raw items are used.
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Build:
    """A published release."""

    release: Release
    report: Mapping[str, Any]  #: Counts by reason, disagreements, classes with several sizes (`report.json`).
    log: Path  #: Folder with `report.json` and `quarantine.jsonl`.


@dataclass(frozen=True, slots=True, eq=False)
class BuildRun:
    """Inputs of all steps of one build."""

    options: BuildOptions
    taxonomy: Callable[[], Taxonomy]
    declared: Mapping[str, Source]
    carried: Release | None
    executor: Executor
    progress: ProgressCallback
    work: BuildFolder

    def map(
        self,
        step: str,
        function: Callable[..., _R],
        calls: Iterable[Any],
        total: int | None,
        spilled: Mapping[str, str] | None = None,
        names: Sequence[str] | None = None,
    ) -> Iterator[_R]:
        """Yield the results of the calls (`BuildFolder.map`), and report the progress out of `total`."""
        for done, result in enumerate(self.work.map(step, function, calls, self.executor, spilled, names), start=1):
            self.progress(step, done, total)
            yield result


def shipped_taxonomy() -> Taxonomy:
    """Return the taxonomy of the package."""
    import taxonomy  # reads WordNet, only if it is used

    default: Callable[[], Taxonomy] = taxonomy.default_taxonomy
    return default()


def shipped_curated() -> Iterable[RawItem]:
    """Return the norms of the package, which fix a class, and its judged ranges, for classes with few items."""
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
    """Build a release at `out` from raw items.

    Parameters
    ----------
    raw : sequence of Path
        Files or folders of raw items, with the images of a crawl next to them; also `Path("s3://bucket/key")`.
    out : Path
        Folder of the release, which must not exist.
    options : BuildOptions
        Name of the release, and the raw items that it omits.
    log : Path, optional
        Folder of `quarantine.jsonl` and `report.json`; default `<out>.build`.
    taxonomy : callable
        Function that returns the taxonomy; it is defined at the top of a module, so that workers can import it.
    curated : iterable of RawItem
        Raw items of the kinds `norm` and `judged`.
    declared : mapping, optional
        Sources by id; default `data/sources`. Rows of other sources are used but not shipped.
    carried : Release, optional
        Earlier release whose item ids, nodes and priors are reused, if `raw` lacks some of its sources. The rows
        are built again from the raw items and are equal byte for byte.
    executor : Executor, optional
        Executor of the steps; default this process.
    progress : callable
        Called with the name of a step, the number of finished parts, and the number of parts or None.

    Raises
    ------
    InputError
        `out` exists or another process is writing it, there are no raw items, a line is not a raw item, or a private
        source has no items.

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
    files, declared, curated_lines, key = _prepared(raw, out, options, curated, declared, carried)
    _check_private(options.private, files)
    log = log or out.with_name(f"{out.name}.build")
    with sole_writer(out), _removed_after_an_error(log), BuildFolder.open(log / "work", key) as work:
        run = BuildRun(options, taxonomy, declared, carried, executor or SerialExecutor(), progress, work)
        counts = ingest(run, files, curated_lines)
        classes, dropped = clean(run, counts["taken"])
        counts += dropped
        if carried is None:
            hierarchy = Hierarchy.of(categories_with_items(taxonomy().categories(), classes))
            models = pool(classes, hierarchy)
            priors = fit(run, classes, hierarchy, models[0])
            tables, manifest, report = _fitted_release(run, classes, hierarchy, models, priors, counts)
        else:
            tables, manifest, report = _carried_release(run, carried, classes, counts)
        release = publish(run, raw, out, log, tables, manifest, report)
    return Build(release, report, log)


def ingest_part(
    raw: Sequence[Path],
    out: Path,
    options: BuildOptions,
    part: tuple[int, int],
    *,
    log: Path | None = None,
    taxonomy: Callable[[], Taxonomy] = shipped_taxonomy,
    curated: Iterable[RawItem] = (),
    declared: Mapping[str, Source] | None = None,
    carried: Release | None = None,
    executor: Executor | None = None,
    progress: ProgressCallback = silent,
) -> Counter[str]:
    """Do step 1 of part I of N, for arrays of jobs with a shared disk, and return the number of items by outcome.

    `build_release` with the same arguments continues the work of all parts. The parameters are those of
    `build_release`.

    Raises
    ------
    InputError
        As of `build_release`, or the work folder contains work of another build.
    """
    files, declared, _, key = _prepared(raw, out, options, curated, declared, carried)
    with BuildFolder.open((log or out.with_name(f"{out.name}.build")) / "work", key, is_shared=True) as work:
        run = BuildRun(options, taxonomy, declared, carried, executor or SerialExecutor(), progress, work)
        return ingest(run, files, "", part)


def ingest(run: BuildRun, files: Sequence[Path], curated_lines: str, part: tuple[int, int] = (1, 1)) -> Counter[str]:
    """Step 1: write the rows of the raw items to the work folder, and return the number of items by outcome.

    Part I of N has every Nth compressed file, and every Nth block of the others.
    """
    folder, (index, n_parts) = run.work.directory, (part[0] - 1, part[1])
    packed = {number: file for number, file in enumerate(files) if file.suffix == ".gz"}
    unpacked = {number: folder / f"{number}.jsonl" for number in packed if number % n_parts == index}
    names = [f"{number:07d}" for number in unpacked]
    calls: Iterable[Any] = ((packed[number], path) for number, path in unpacked.items())
    for _ in run.map("unpack", unpack, calls, len(unpacked), names=names):
        pass
    curated = folder / "curated.jsonl"
    if curated_lines:
        curated.write_text(curated_lines, encoding="utf-8")
    all_blocks: dict[str, Block] = {}
    for number, file in enumerate(files):
        if number in unpacked or number not in packed:
            for place, block in enumerate(blocks(unpacked.get(number, file), url_of(file))):
                if number in packed or (number + place) % n_parts == index:
                    all_blocks[f"{number:05d}-{place:07d}"] = block
    if curated_lines:
        all_blocks |= {f"curated-{place:07d}": one for place, one in enumerate(blocks(curated, "curated ranges"))}
    omitted = (name for name, source in run.declared.items() if source.noncommercial)
    left_out = frozenset() if run.options.noncommercial else frozenset(omitted)
    calls = ((block, run.taxonomy, run.options.fold_out, left_out) for block in all_blocks.values())
    counts: Counter[str] = Counter()
    spilled = {"rows": ".arrow", "refused": ".refused"}
    for result in run.map("ingest", ingest_block, calls, len(all_blocks), spilled, list(all_blocks)):
        counts += result.counts
    return counts


def clean(run: BuildRun, n_rows: int) -> tuple[dict[str, NodeClass], Counter[str]]:
    """Step 2: return the classes by node id, and the number of dropped rows by reason, from `n_rows` ingested rows."""
    folder = run.work.directory
    n_partitions = max(1, -(-n_rows // MAX_PARTITION_ROWS))
    calls: Iterable[Any] = ((folder, partition, n_partitions) for partition in range(n_partitions))
    repeats = run.map("repeats", repeated_rows, calls, n_partitions, {"places": ".arrow"})
    counts = Counter({"repeated_id": sum(result.count for result in repeats)})
    sizes = list(run.map("sizes", shard_sizes, ((folder, shard) for shard in range(SHARDS)), SHARDS))
    all_sizes = {node_id: node for shard in sizes for node_id, node in shard.items()}
    siblings = sibling_references(all_sizes, run.taxonomy().categories())
    references = {node_id: node.reference or siblings.get(node_id) for node_id, node in all_sizes.items()}
    terms = {
        source.id: (source.licence, source.attribution)
        for source in (*run.declared.values(), *PROJECT_SOURCES.values())
        if source.ship
    }
    terms |= {source: (PRIVATE_LICENCE, source) for source in run.options.private}
    ids = frozenset(run.carried.table("items")["item_id"].to_pylist()) if run.carried else None
    names_of = (
        [node_id.partition(".")[0].replace("mt:", "") for node_id, node in shard.items() if node.n_ids]
        for shard in sizes
    )
    common = [frozenset("_".join(names).split("_")) for names in names_of]
    every_unit = [unit for shard, nodes in enumerate(sizes) for unit in units(shard, nodes)]
    calls = (
        (folder, unit, terms, {node_id: references[node_id] for node_id in unit.nodes}, common[unit.shard], ids)
        for unit in every_unit
    )
    names = [f"{unit.shard:03d}-{number:07d}" for number, unit in enumerate(every_unit)]
    spilled = {"items": ".items", "refused": ".refused", "rows": ".rows"}
    n_by_evidence = [dict[str, Counter[tuple[str, str]]]() for _ in range(SHARDS)]
    cleaned = run.map("clean", clean_unit, calls, len(every_unit), spilled, names)
    for unit, result in zip(every_unit, cleaned, strict=True):
        counts += result.counts
        for node_id, numbers in result.n_by_evidence.items():
            n_by_evidence[unit.shard].setdefault(node_id, Counter()).update(numbers)
    shards = [(folder, shard, numbers) for shard, numbers in enumerate(n_by_evidence) if numbers]
    parts = run.map("classes", shard_classes, shards, len(shards), {"rows": ".classes"})
    return {one.node_id: one for part in parts for one in part.classes}, counts


def pool(classes: Mapping[str, NodeClass], hierarchy: Hierarchy) -> tuple[EvidenceModel, ContextModel]:
    """Step 3: fit the model of the kinds of evidence, and the model of regions and years, to all classes."""
    families = hierarchy.families()
    by_source = {node_id: one.moments.by_source for node_id, one in classes.items()}
    known = {node_id: means for node_id, means in by_source.items() if means is not None}
    model = fit_evidence_model(((families[node_id], means) for node_id, means in known.items()), sorted(KIND_WEIGHT))
    contexts = fit_context_model(
        (
            classes[node_id].contexts,
            np.diagonal(means.within),
            np.diagonal(shrunk_between(means, model, families[node_id])),
        )
        for node_id, means in known.items()
        if classes[node_id].contexts
    )
    return model, contexts


def fit(
    run: BuildRun, classes: Mapping[str, NodeClass], hierarchy: Hierarchy, model: EvidenceModel
) -> dict[str, list[Prior]]:
    """Step 4: fit the priors of the leaves, and compute the priors of the inner nodes."""
    families = hierarchy.families()
    parents = {category.node_id: category.parent_id or "" for category in hierarchy.categories}
    by_parent = hierarchy.beliefs(m for one in classes.values() for m in one.all_moments)
    beliefs = {node_id: by_parent[parents[node_id], one.moments.axes] for node_id, one in classes.items()}
    files = sorted(run.work.directory.glob("classes-*.classes"))
    options = run.options
    calls = ((path, beliefs, families, model, options.seed, options.heldout) for path in files)
    fitted = {prior.node_id: prior for priors in run.map("fit", class_priors, calls, len(files)) for prior in priors}
    leaves = {
        node_id: replace(fitted[node_id], norm=one.norm)
        if one.norm
        else class_contexts(fitted[node_id], one.moments.axes, one.contexts, np.diagonal(one.moments.within))
        for node_id, one in classes.items()
    }
    return hierarchy.priors(leaves, classes, stated_frequencies())


def publish(
    run: BuildRun,
    raw: Sequence[Path],
    out: Path,
    log: Path,
    tables: dict[str, pa.Table],
    manifest: Mapping[str, Any],
    report: dict[str, Any],
) -> Release:
    """Step 5: write the log and the release; images are added to `tables` and `report`."""
    extras = run.work.directory / "extras"
    extras.mkdir(exist_ok=True)
    if run.options.pictures:
        add_images(raw, tables, report, extras)
    manifest = {**manifest, "basis": basis(manifest)}
    write_texts(extras, tables, manifest, former=run.taxonomy is shipped_taxonomy)
    write_log(log, run.work.directory, report)  # first, because a run that finds a release stops before the log
    return publish_release(out, tables, manifest, extras)


def _fitted_release(
    run: BuildRun,
    classes: Mapping[str, NodeClass],
    hierarchy: Hierarchy,
    models: tuple[EvidenceModel, ContextModel],
    priors: Mapping[str, list[Prior]],
    counts: Counter[str],
) -> tuple[dict[str, pa.Table], dict[str, Any], dict[str, Any]]:
    """Return tables, manifest and report of a release with its own priors."""
    options = run.options
    nodes = node_table(hierarchy, classes, priors)
    items = _shipped_items(run.work)
    tables = {
        "nodes.parquet": nodes,
        "items.parquet": items,
        "priors.parquet": prior_table(hierarchy, hierarchy.with_correlations(dict(priors), classes)),
        "images.parquet": IMAGES.empty_table(),
    }
    n_fit: Counter[str] = Counter()
    for one in classes.values():
        n_fit.update(one.n_by_source)
    n_rows = Counter(items["source"].to_pylist())
    used = frozenset().union(*(one.kinds for one in classes.values()))
    node_ids = frozenset(nodes["node_id"].to_pylist())
    raw_counts = dict(sorted(counts.items()))
    manifest = {
        "name": options.name,
        "version": options.version,
        "created": options.created,
        "sources": source_records(run.declared, n_fit, n_rows, used),
        "counts": node_counts(nodes) | {"n_fit": n_fit.total(), "n_rows": items.num_rows, "raw": raw_counts},
        "evidence": evidence_counts(classes.values()),
        "tiers": tier_counts(nodes),
        "judged_by": writers(),
        "states": state_records(node_ids),
        "heights": height_records(node_ids),
        "noncommercial": options.noncommercial,
        "private": sorted(options.private),
        "fold_out": list(options.fold_out) if options.fold_out else None,
        "evidence_model": models[0].record(),
        "context_model": models[1].record(),
    }
    leaves = {node_id: priors[node_id][0] for node_id in classes}
    return tables, manifest, build_report(classes, leaves, models[0], raw_counts, hierarchy, items)


def _carried_release(
    run: BuildRun, carried: Release, classes: Mapping[str, NodeClass], counts: Counter[str]
) -> tuple[dict[str, pa.Table], dict[str, Any], dict[str, Any]]:
    """Return tables, manifest and report: the rows of this build with the nodes and priors of an earlier release."""
    items = _shipped_items(run.work)
    tables = {f"{name}.parquet": carried.table(name) for name in ("nodes", "priors", "images")}
    tables["items.parquet"] = items
    manifest = {**carried.manifest, "carried": {"version": carried.manifest["version"], "what": CARRIED}}
    n_rows = Counter(items["source"].to_pylist())
    manifest["sources"] = [record | {"n_rows": n_rows[record["id"]]} for record in manifest["sources"]]
    manifest["counts"] = manifest["counts"] | {"n_rows": items.num_rows}
    manifest |= {name: getattr(run.options, name) for name in ("name", "version", "created")}
    return tables, manifest, {"raw": dict(sorted(counts.items())), "classes": len(classes)}


def _shipped_items(work: BuildFolder) -> pa.Table:
    """Return the shipped items, memory-mapped from the work folder."""
    files = sorted(work.directory.glob("clean-*.items"))
    return pa.concat_tables([pa.ipc.open_file(pa.memory_map(str(path))).read_all() for path in files])


def _check_private(private: Sequence[str], files: Iterable[Path]) -> None:
    """Check that every private source has raw items; a misspelt one would be withheld without notice."""
    present: set[str] = set()
    for item in (item for file in files for item in raw_items(file)) if private else ():
        present.add(item.source)
        if present.issuperset(private):  # a large folder need not be read completely
            return
    if missing := sorted(set(private) - present):
        known = ", ".join(sorted(present)) or "none"
        raise InputError(f"--include-withheld: expected sources of the raw items ({known}); found {', '.join(missing)}")


def _prepared(
    raw: Sequence[Path],
    out: Path,
    options: BuildOptions,
    curated: Iterable[RawItem],
    declared: Mapping[str, Source] | None,
    carried: Release | None,
) -> tuple[list[Path], Mapping[str, Source], str, str]:
    """Return raw files, sources, lines of the curated items, and key of the work; it does not depend on the date."""
    if out.exists():
        raise InputError(f"{out}: already exists; expected a new path for a release")
    files = raw_files(raw)
    declared = {source.id: source for source in sources()} if declared is None else declared
    curated_lines = "".join(f"{item.line()}\n" for item in curated)
    content = replace(options, version="", created="", name="")
    key = fingerprint(files, repr((content, sorted(declared.items()), curated_lines, carried)))
    return files, declared, curated_lines, key


@contextmanager
def _removed_after_an_error(log: Path) -> Iterator[None]:
    """Remove the empty folder of the log if the input is invalid."""
    try:
        yield
    except InputError:
        with suppress(OSError):  # it contains the log of an earlier build
            log.rmdir()
        raise
