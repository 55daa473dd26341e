"""Clean the units of a build, compute its classes (step 2), and fit their priors (step 4)."""

from __future__ import annotations

import pickle
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.axes import AXES, EXTENTS, axis_assignments
from metric_tree.checks.duplicates import duplicates, extent_codes
from metric_tree.checks.unit_errors import Reference, unit_error_factors
from metric_tree.curated.sizes import norm_shares
from metric_tree.fit.class_prior import class_prior
from metric_tree.fit.contexts import ContextMean, context_means
from metric_tree.fit.evidence_model import EvidenceModel
from metric_tree.fit.intraclass_correlation import IntraclassCorrelation, class_correlation
from metric_tree.fit.mixture import NormalInverseWishart
from metric_tree.fit.moments import Moments, extent_moments, moments
from metric_tree.fit.rows import (
    JUDGED,
    NORM,
    STATEMENTS,
    STRONG,
    ClassRows,
    extents_of,
    matrix_of_lists,
    without_open_numbers,
)
from metric_tree.pipeline.ingest import ROWS, refusal
from metric_tree.pipeline.shards import MAX_UNIT_ROWS, Unit, hash_ranks, rows_by_node, unit_rows
from metric_tree.prior import Prior
from metric_tree.release.schema import ITEMS

#: Maximum number of rows per source in the fit of a class; the rows with the lowest hashes are kept. The weight of a
#: source is bounded anyway (`fit.rows.SOURCE_HALF_ROWS`), and 200 rows determine its mean to 1/14 of the standard
#: deviation.
MAX_FIT_ROWS = 200
#: Maximum number of words of the title of a product or of a model of one; longer ones describe it for sale.
MAX_TITLE_WORDS = 8
#: Kinds of these titles. Museums, standards and judged ranges have titles of their own, documents and reasons.
SHORT_TITLES = frozenset({"product", "measured", "asset"})
#: Maximum number of rows that are compared with their class, and among which duplicates are searched, at once.
MAX_GROUP_ROWS = 20_000
#: Maximum number of rows of a class that determine its contexts and its correlation over rooms: the rows with the
#: lowest hashes.
MAX_CLASS_ROWS = 20_000
#: Flag of rows whose size may be the size of the package.
PACKAGE = "suspect_package"
#: Rows of which a class is made.
CLASS_ROWS = pa.schema([field for field in ROWS if field.name not in {"item_id", "url", "attribution"}])


@dataclass(frozen=True, slots=True, eq=False)
class NodeClass:
    """Result of step 2 for a leaf, without its rows."""

    node_id: str
    moments: Moments  #: In the axes of the pose of the leaf.
    extent_moments: Moments | None  #: Over sorted extents; None if these are the axes of the pose.
    n_by_source: Mapping[str, int]  #: Number of items.
    n_by_kind: Mapping[str, int]  #: Number of rows.
    kinds: Mapping[str, str]  #: Kind of evidence by source.
    correlation: IntraclassCorrelation | None = None  #: Over rooms, if they are known.
    contexts: tuple[ContextMean, ...] = ()  #: In the axes of the pose.
    norm: str | None = None  #: Documents and clauses of the standards that fix the size.

    @property
    def all_moments(self) -> tuple[Moments, ...]:
        """The moments in both frames of axes."""
        return (self.moments,) if self.extent_moments is None else (self.moments, self.extent_moments)


@dataclass(frozen=True, slots=True, eq=False)
class CleanUnit:
    """Result of step 2 for a unit, with bytes that the work folder stores."""

    items: bytes  #: Arrow file of `ITEMS`, the items that may be shipped.
    rows: bytes  #: Arrow file of rows for the classes; a batch is a node.
    refused: bytes  #: Lines of the quarantine file.
    counts: Counter[str]  #: Refused rows by reason.
    n_by_evidence: Mapping[str, Counter[tuple[str, str]]]  #: Accepted rows of each node by source and kind.


@dataclass(frozen=True, slots=True, eq=False)
class ShardClasses:
    """Classes of the nodes of a shard."""

    classes: tuple[NodeClass, ...]
    rows: bytes  #: Pickled rows for the fits, one `ClassRows` for each class.


def clean_unit(
    folder: Path,
    unit: Unit,
    terms: Mapping[str, tuple[str, str]],
    references: Mapping[str, Reference | None],
    common: frozenset[str],
    carried: frozenset[str] | None = None,
) -> CleanUnit:
    """Remove repeats and unit errors from a unit, and select the rows of which its classes are made.

    Parameters
    ----------
    folder : Path
        Work folder with the ingested rows.
    unit : Unit
        Nodes of a shard, or a part of a node.
    terms : mapping
        Licence and attribution of each source whose rows may be redistributed.
    references : mapping
        Reference sizes of the nodes of the unit, None without.
    common : frozenset of str
        Words of the names of categories, which identify no product.
    carried : frozenset of str, optional
        Ids of the items of an earlier release. If given, exactly these items are kept, and the checks are skipped.
    """
    rows = unit_rows(folder, unit)
    if carried is None:
        reasons = _refusal_reasons(rows, _sizes(rows), frozenset(terms), references, common)
    else:
        reasons = ["" if item_id in carried else "not_carried" for item_id in rows["item_id"].to_pylist()]
    good = np.array([not reason for reason in reasons], dtype=bool)
    refused_reasons = [reason for reason in reasons if reason]
    lines = _refused_lines(rows.filter(pa.array(~good)), refused_reasons)
    counts = Counter(reason.partition(":")[0] for reason in refused_reasons)
    rows = rows.filter(pa.array(good))
    n_by_evidence = {}
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, CLASS_ROWS, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
        for chosen in rows_by_node(rows):
            node = rows.slice(int(chosen[0]), len(chosen))
            pairs = zip(node["source"].to_pylist(), node["kind"].to_pylist(), strict=True)
            n_by_evidence[node["node_id"][0].as_py()] = Counter(pairs)
            writer.write_table(_class_sample(node.select(CLASS_ROWS.names)).combine_chunks())
    items = pa.BufferOutputStream()
    with pa.ipc.new_file(items, ITEMS) as writer:
        writer.write_table(_shipped_items(rows, terms).combine_chunks())
    refused = "".join(lines).encode()
    return CleanUnit(bytes(items.getvalue()), bytes(sink.getvalue()), refused, counts, n_by_evidence)


def _class_sample(rows: pa.Table) -> pa.Table:
    """Return at most `MAX_CLASS_ROWS` rows of one node, and `MAX_FIT_ROWS` of each source: the lowest hashes."""
    if rows.num_rows <= MAX_CLASS_ROWS:
        return rows
    is_low = hash_ranks(rows["node_id"], rows["hash"]) < MAX_CLASS_ROWS
    return rows.filter(pa.array(is_low | (hash_ranks(rows["source"], rows["hash"]) < MAX_FIT_ROWS)))


def shard_classes(folder: Path, shard: int, n_by_evidence: Mapping[str, Counter[tuple[str, str]]]) -> ShardClasses:
    """Compute the classes of a shard from the rows of its units, and the rows of their fits.

    Parameters
    ----------
    folder : Path
        Work folder with the cleaned units.
    shard : int
        Number of the shard.
    n_by_evidence : mapping
        Number of accepted rows of each node by source and kind.
    """
    files = (pa.ipc.open_file(pa.memory_map(str(path))) for path in sorted(folder.glob(f"clean-{shard:03d}-*.rows")))
    batches = (file.get_batch(number) for file in files for number in range(file.num_record_batches))
    classes: list[tuple[NodeClass, ClassRows]] = []
    for node_id, parts in groupby(batches, key=lambda batch: batch["node_id"][0].as_py()):
        rows = CLASS_ROWS.empty_table()
        for part in parts:
            rows = _class_sample(pa.concat_tables([rows, pa.Table.from_batches([part])]))
        classes.append(_node_class(rows, n_by_evidence[node_id]))
    return ShardClasses(tuple(one for one, _ in classes), pickle.dumps([rows for _, rows in classes]))


def _sizes(table: pa.Table) -> FloatArray:
    """Return length, width, height and sorted extents of each row, (n, 6) in mm."""
    axes = [table[f"{axis}_mm"].to_numpy(zero_copy_only=False).astype(float) for axis in AXES]
    return np.column_stack([*axes, extents_of(table)])


def _refused_lines(table: pa.Table, reasons: Sequence[str]) -> list[str]:
    """Return the lines of the quarantine file for refused rows."""
    lines = []
    for row, reason in zip(table.to_pylist(), reasons, strict=True):
        code, _, detail = reason.partition(": ")
        extents = " x ".join(f"{side:g}" for side in row["extents_mm"])
        text = f"{row['node_id']}: {extents} mm" + (f" ({detail})" if detail else "")
        lines.append(refusal(code, row["source"], row["source_id"], row["title"], (), text))
    return lines


def _shipped_items(table: pa.Table, terms: Mapping[str, tuple[str, str]]) -> pa.Table:
    """Return the rows that may be redistributed as `ITEMS`, with the terms of their sources and short titles."""
    ship = np.isin(_strings(table, "source"), sorted(terms)) & (_strings(table, "kind") != "statistic")
    items = table.filter(pa.array(ship))
    for place, column in enumerate(("licence", "attribution")):
        of_source = pa.array([terms[source][place] for source in items["source"].to_pylist()], pa.string())
        values = pc.coalesce(items[column], of_source)
        items = items.set_column(items.schema.get_field_index(column), column, values)
    rows = zip(items["title"].to_pylist(), items["kind"].to_pylist(), strict=True)
    titles = pa.array([short_title(title) if kind in SHORT_TITLES else title for title, kind in rows], pa.string())
    items = items.set_column(items.schema.get_field_index("title"), "title", titles)
    return items.select(ITEMS.names).cast(ITEMS)


def short_title(title: str) -> str:
    """Return a title up to its first comma, dash or `with`, and with at most `MAX_TITLE_WORDS` words.

    >>> short_title("Meshify 2 Nano - Mini-ITX tower in black with a side panel of glass")
    'Meshify 2 Nano'
    """
    words = title.split()
    if len(words) <= MAX_TITLE_WORDS:
        return title
    name = re.split(r", | [-\N{EN DASH}] | with ", title, maxsplit=1)[0].split()
    return " ".join((name if len(name) > 1 else words)[:MAX_TITLE_WORDS])


def class_priors(
    path: Path,
    beliefs: Mapping[str, NormalInverseWishart],
    families: Mapping[str, str],
    model: EvidenceModel,
    seed: int,
    heldout: bool,
) -> list[Prior]:
    """Fit the priors of the classes of a shard, in order, from the file of `CleanShard.rows`."""
    classes: list[ClassRows] = pickle.loads(path.read_bytes())  # noqa: S301 - written by `clean_shard` in this build
    return [class_prior(one, beliefs[one.node_id], model, families[one.node_id], seed, heldout) for one in classes]


def _refusal_reasons(
    table: pa.Table,
    sizes: FloatArray,
    shipped: frozenset[str],
    references: Mapping[str, Reference | None],
    common: frozenset[str],
) -> list[str]:
    """Return the rejection reason of each row, empty if it is accepted. Unit errors are found before duplicates.

    Duplicates have equal extents, so that they are searched among the rows whose extents occur twice, in partitions of
    these rows by extents.

    Parameters
    ----------
    table : pyarrow.Table
        The n rows, sorted by node.
    sizes : (n, 6) ndarray of float
        Length, width, height and the sorted extents in mm.
    shipped : frozenset of str
        Sources whose rows may be redistributed.
    references : mapping
        Reference sizes of the nodes, None without.
    common : frozenset of str
        Words of the names of categories.
    """
    reasons = [""] * table.num_rows
    extents = sizes[:, 3:]
    is_real, node = ~np.isin(_strings(table, "kind"), sorted(STATEMENTS)), table["node_id"]
    for rows in rows_by_node(table):
        real = rows[is_real[rows]]
        reference = references[node[int(rows[0])].as_py()]
        if reference is None or not len(real):
            continue
        for some in np.array_split(real, 1 + len(real) // MAX_GROUP_ROWS):
            for row, factor in zip(some, unit_error_factors(extents[some], reference), strict=True):
                if factor != 1.0:
                    reasons[row] = f"unit_slip: {factor:g}" if np.isfinite(factor) else "far_outlier"
    remaining = np.array([row for row, reason in enumerate(reasons) if not reason], dtype=np.intp)
    hashes = extent_codes(extents[remaining])
    _, code, counts = np.unique(hashes, return_inverse=True, return_counts=True)
    is_repeated = counts[code] > 1
    remaining, hashes = remaining[is_repeated], hashes[is_repeated]
    n_partitions = 1 + len(remaining) // MAX_GROUP_ROWS
    for number in range(n_partitions):
        rows = remaining[hashes // MAX_UNIT_ROWS % n_partitions == number]  # the remainder divides large nodes
        chosen = table.select(["item_id", "node_id", "source", "kind", "title"]).take(pa.array(rows))
        ids, nodes, source, kind, title = (column.to_pylist() for column in chosen.columns)
        repeats = duplicates(nodes, sizes[rows], source, kind, title, [name in shipped for name in source], common)
        for row, original in zip(rows, repeats, strict=True):
            if original >= 0:
                reasons[row] = f"duplicate: {ids[original]}"
    return reasons


def _node_class(table: pa.Table, n_by_evidence: Counter[tuple[str, str]]) -> tuple[NodeClass, ClassRows]:
    """Return the class of one node and its rows for the fit, from a sample of its rows and the numbers of all rows."""
    sizes = _sizes(table)
    node_id, pose = table["node_id"][0].as_py(), table["pose"][0].as_py()
    source, kind = _strings(table, "source"), _strings(table, "kind")
    scene = np.array([text or "" for text in table["scene"].to_pylist()], dtype=str)
    # Data sets that measured the same rooms count as one source. The prefix of a scene before the slash is its set of
    # rooms.
    rooms = np.array([text.partition("/")[0] for text in scene.tolist()], dtype=str)
    origin = np.where(rooms != "", rooms, source)
    n_by_source, n_by_kind = Counter[str](), Counter[str]()
    for (source_id, kind_of_rows), count in n_by_evidence.items():
        n_by_kind[kind_of_rows] += count
        if kind_of_rows not in STATEMENTS:
            n_by_source[source_id] += count

    # 1. The rows of the fit: at most MAX_FIT_ROWS per source, without suspected packages if there are other rows.
    fit = np.flatnonzero(hash_ranks(table["source"], table["hash"]) < MAX_FIT_ROWS)
    flags = table["flags"].take(pa.array(fit)).to_pylist()
    is_package: NDArray[np.bool_] = np.array([PACKAGE in (row or ()) for row in flags], dtype=bool)
    if (~is_package & np.isin(kind[fit], sorted(STRONG | {JUDGED}))).any():
        fit = fit[~is_package]

    share = _scene_share(scene[fit])
    of_norms = table.take(pa.array(fit[kind[fit] == NORM]))
    share[kind[fit] == NORM] = [norm_shares().get(one, 1.0) for one in of_norms["source_id"].to_pylist()]

    # 2. Possible axis assignments of these rows, by pose and by sorted extents.
    range_sd = np.full((table.num_rows, 3), np.nan)
    if table["range_sd"].null_count < table.num_rows:
        range_sd = matrix_of_lists(table["range_sd"])
    frames = []
    for frame, axes in {pose: EXTENTS if pose == "any" else AXES, "any": EXTENTS}.items():
        x, owner = axis_assignments(sizes[fit, :3], sizes[fit, 3:], frame)
        first = x[np.searchsorted(owner, np.arange(len(fit)))]  # (k, 3)
        is_extent = np.isclose(first[:, :, None], sizes[fit, None, 3:])  # (k, axis, extent)
        sd = np.take_along_axis(range_sd[fit], is_extent.argmax(axis=2), axis=1)
        sd = np.where(is_extent.any(axis=2), sd, np.nan)
        names = tuple(origin[fit].tolist()), tuple(kind[fit].tolist())
        frames.append(ClassRows(node_id, axes, np.log(x), owner, *names, sd, n_by_source.total(), share))
    pose_rows = without_open_numbers(frames[0])

    # 3. Moments, correlation over rooms, and contexts.
    logs = np.log(sizes[:, 3:] if pose == "any" else sizes[:, :3])
    places = table["region"].to_pylist(), table["year"].to_pylist()
    node_class = NodeClass(
        node_id,
        moments(pose_rows),
        None if pose == "any" else extent_moments(frames[1]),
        dict(n_by_source),
        dict(n_by_kind),
        dict(zip(source.tolist(), kind.tolist(), strict=True)),
        class_correlation(logs, source, scene),
        context_means(logs, origin, kind, *places, _scene_share(scene)),
        "; ".join(sorted(set(of_norms["title"].to_pylist()))) or None,
    )
    return node_class, pose_rows


def _scene_share(scene: NDArray[np.str_]) -> FloatArray:
    """Return the reciprocal of the number of rows in the scene of each row, (n,); 1 if the scene is unknown."""
    _, code, counts = np.unique(scene, return_inverse=True, return_counts=True)
    return np.where(scene != "", 1 / counts[code], 1.0)


def _strings(table: pa.Table, column: str) -> NDArray[np.str_]:
    """Return a column as text, (n,)."""
    encoded = pc.dictionary_encode(table[column].combine_chunks())
    strings: NDArray[np.str_] = np.array(encoded.dictionary.to_pylist() or [""], dtype=str)[encoded.indices.to_numpy()]
    return strings
