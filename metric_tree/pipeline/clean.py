"""One shard of a build: repeats and unit slips taken out, the rest turned into rows of items and of fits."""

from __future__ import annotations

import pickle
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.axes import AXES, EXTENTS, axis_assignments
from metric_tree.checks.duplicates import duplicates
from metric_tree.checks.unit_errors import Reference, reference, slip_factors
from metric_tree.fit.class_prior import class_prior
from metric_tree.fit.contexts import ContextCell, cells_of
from metric_tree.fit.evidence_model import KindModel
from metric_tree.fit.intraclass_correlation import Sameness, class_sameness
from metric_tree.fit.mixture import Belief
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
from metric_tree.pipeline.ingest import refusal
from metric_tree.prior import Prior
from metric_tree.release.schema import ITEMS

#: Rows of one source in one class that the fit takes, those of the lowest hash: its weight there is bounded anyway
#: (`evidence.SOURCE_HALF`), and two hundred tell its mean to a fourteenth of its spread.
FIT_ROWS = 200
#: Flag of rows whose size may be that of the package.
PACKAGE = "suspect_package"
REFUSALS = {
    "repeated_id": "the source has the id twice",
    "duplicate": "the same figures again, in the same source or of the same product in another",
    "unit_slip": "a unit's factor away from its class",
    "far_outlier": "far outside its class, and no unit explains it",
    "not_carried": "the release that is carried over does not have it",
}


@dataclass(frozen=True, slots=True, eq=False)
class NodeClass:
    """Of one leaf: moments in the axes of its pose, then by extents; items by source, rows by kind, kind by source.

    sameness : what the objects of one room have in common, where rooms are known; cells : means by source, region and
    years, in the axes of the pose; norm : document and clause of the standards that fix the size.
    """

    node_id: str
    moments: tuple[Moments, ...]
    n_by_source: Mapping[str, int]
    n_by_kind: Mapping[str, int]
    kinds: Mapping[str, str]
    sameness: Sameness | None = None
    cells: tuple[ContextCell, ...] = ()
    norm: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Cleaned:
    """Of one shard.

    items : those that may be shipped, an Arrow file of `ITEMS`; rows : those of the fits (`ClassRows`), pickled;
    refused : lines of the quarantine file; counts : rows refused, by reason.
    """

    items: bytes
    classes: tuple[NodeClass, ...]
    rows: bytes
    refused: bytes
    counts: Counter[str]


def clean_shard(
    shard: bytes, licences: Mapping[str, str], siblings: Mapping[str, Reference], carried: frozenset[str] | None = None
) -> Cleaned:
    """A shard without repeats and slips.

    Parameters
    ----------
    shard : an Arrow file of `metric_tree.pipeline.ingest.ROWS`; licences : of the sources whose rows may be given on
    siblings : for thin nodes, where the sizes of their siblings lie
    carried : ids of the items of an earlier release whose choice of rows holds in place of the checks
    """
    table = pa.ipc.open_file(shard).read_all()
    shipped = frozenset(licences)
    table = table.take(pc.sort_indices(table, [("node_id", "ascending"), ("item_id", "ascending")]))
    sizes = np.column_stack([_axes(table), extents_of(table)])  # (n, 6)
    if carried is None:
        reasons = _refusal_reasons(table, sizes, shipped, siblings)
    else:
        reasons = ["" if item_id in carried else "not_carried" for item_id in table["item_id"].to_pylist()]
    good = np.array([not reason for reason in reasons], dtype=bool)
    refused = _refusal_lines(table.filter(pa.array(~good)), [reason for reason in reasons if reason])
    table, sizes = table.filter(pa.array(good)), sizes[good]
    ship = np.isin(_strings(table, "source"), sorted(shipped)) & (_strings(table, "kind") != "statistic")
    classes = [_class(table.take(pa.array(rows)), sizes[rows]) for rows in _nodes(table)]
    counts = Counter(reason.partition(":")[0] for reason in reasons if reason)
    rows = pickle.dumps([own for _, own in classes])
    return Cleaned(
        _items(table.filter(pa.array(ship)), licences), tuple(one for one, _ in classes), rows, refused, counts
    )


def class_priors(
    rows: bytes, beliefs: Mapping[str, Belief], families: Mapping[str, str], model: KindModel, seed: int, heldout: bool
) -> list[Prior]:
    """The priors of the classes of one shard, in their order; `rows` as in `Cleaned`."""
    classes: list[ClassRows] = pickle.loads(rows)  # noqa: S301 - made by `cleaned` in this build
    return [class_prior(one, beliefs[one.node_id], model, families[one.node_id], seed, heldout) for one in classes]


def _refusal_reasons(
    table: pa.Table, sizes: FloatArray, shipped: frozenset[str], siblings: Mapping[str, Reference]
) -> list[str]:
    """Why each row is refused, empty where it is not, by its sizes (n, 6); a slip is looked for first."""
    reasons = [""] * table.num_rows
    extents = sizes[:, 3:]
    ids, kinds = table["item_id"].to_pylist(), table["kind"].to_pylist()
    node = table["node_id"].to_pylist()
    for rows in _nodes(table):
        real = rows[[kinds[row] not in STATEMENTS for row in rows]]
        against = reference(extents[real]) or siblings.get(node[rows[0]])
        for row, factor in zip(
            real, slip_factors(extents[real], against) if against and len(real) else (), strict=False
        ):
            if factor != 1.0:
                reasons[row] = f"unit_slip: {factor:g}" if np.isfinite(factor) else "far_outlier"
    left = np.array([row for row, reason in enumerate(reasons) if not reason], dtype=np.intp)
    chosen = table.select(["source", "kind", "title"]).take(pa.array(left))
    source, kind, title = (chosen[name].to_pylist() for name in ("source", "kind", "title"))
    common = frozenset(word for name in set(node) for word in name.partition(".")[0].replace("mt:", "").split("_"))
    repeats = duplicates(
        [node[row] for row in left], sizes[left], source, kind, title, [name in shipped for name in source], common
    )
    for row, repeated in zip(left, repeats, strict=True):
        if repeated >= 0:
            reasons[row] = f"duplicate: {ids[left[repeated]]}"
    return reasons


def _refusal_lines(table: pa.Table, reasons: Sequence[str]) -> bytes:
    lines = []
    for row, reason in zip(table.to_pylist(), reasons, strict=True):
        code, _, detail = reason.partition(": ")
        sides = " x ".join(f"{side:g}" for side in row["extents_mm"])
        text = f"{row['node_id']}: {sides} mm" + (f" ({detail})" if detail else "")
        lines.append(refusal(code, row["source"], row["source_id"], row["title"], (), text))
    return "".join(lines).encode()


def _class(table: pa.Table, sizes: FloatArray) -> tuple[NodeClass, ClassRows]:
    """The class of one node's rows, sizes (n, 6) in mm, and the rows that its fit takes."""
    node_id, pose = table["node_id"][0].as_py(), table["pose"][0].as_py()
    source, kind = _strings(table, "source"), _strings(table, "kind")
    real = ~np.isin(kind, sorted(STATEMENTS))
    by_source = Counter(source[real].tolist())
    scene = np.array([text or "" for text in table["scene"].to_pylist()], dtype=str)
    fit = _fit_rows(source, table["hash"].to_numpy())
    fit = fit[_trust_mask(kind[fit], table["flags"].take(pa.array(fit)).to_pylist())]
    world, scene_share = _worlds(source[fit], scene[fit]), _scene_shares(scene[fit])
    spreads = _range_sd(table)
    frames = [
        _class_rows(node_id, name, axes, sizes[fit], world, kind[fit], spreads[fit], int(real.sum()), scene_share)
        for name, axes in ((pose, EXTENTS if pose == "any" else AXES), ("any", EXTENTS))
    ]
    frames = frames[:1] if pose == "any" else frames
    frames[0] = without_open_numbers(frames[0])
    by_kind = dict(Counter(kind.tolist()))
    own = np.log(sizes[:, 3:] if pose == "any" else sizes[:, :3])
    places = table["region"].to_pylist(), table["year"].to_pylist()
    node_class = NodeClass(
        node_id,
        (moments(frames[0]), *map(extent_moments, frames[1:])),
        dict(by_source),
        by_kind,
        dict(zip(source.tolist(), kind.tolist(), strict=True)),
        class_sameness(own, source, scene),
        cells_of(own, _worlds(source, scene), kind, *places, _scene_shares(scene)),
        "; ".join(sorted(set(table.filter(pa.array(kind == NORM))["title"].to_pylist()))) or None,
    )
    return node_class, frames[0]


def _class_rows(
    node_id: str,
    pose: str,
    axes: tuple[str, ...],
    sizes: FloatArray,
    source: NDArray[np.str_],
    kind: NDArray[np.str_],
    spreads: FloatArray,
    n: int,
    scene_share: FloatArray,
) -> ClassRows:
    """The rows of a class for its fit in one frame of axes.

    sizes : (n, 6) mm, stated axes and then extents, NaN where missing; source, kind : (n,) of the rows; spreads :
    (n, 3) stated standard deviations of ln size of the extents, NaN without; n : items that the rows stand for;
    scene_share : (n,) one over the rows in the row's scene.
    """
    x, owner = axis_assignments(sizes[:, :3], sizes[:, 3:], pose)
    first = x[np.searchsorted(owner, np.arange(len(sizes)))]  # (n, 3)
    same = np.isclose(first[:, :, None], sizes[:, None, 3:])  # each axis beside the extents it may be
    range_sd = np.where(same.any(axis=2), np.take_along_axis(spreads, same.argmax(axis=2), axis=1), np.nan)
    names = tuple(source.tolist()), tuple(kind.tolist())
    return ClassRows(node_id, axes, np.log(x), owner, *names, range_sd, n, scene_share)


def _worlds(source: NDArray[np.str_], scene: NDArray[np.str_]) -> NDArray[np.str_]:
    """Source of each row, (n,); sets that measured the same rooms are one source, that of the rooms."""
    rooms = np.array([text.partition("/")[0] for text in scene.tolist()], dtype=str)
    return np.where(rooms != "", rooms, source)


def _scene_shares(scene: NDArray[np.str_]) -> FloatArray:
    """One over the rows in the scene of each row, (n,); one where the scene is unknown."""
    _, code, counts = np.unique(scene, return_inverse=True, return_counts=True)
    return np.where(scene != "", 1 / counts[code], 1.0)


def _trust_mask(kind: NDArray[np.str_], flags: Sequence[Sequence[str] | None]) -> NDArray[np.bool_]:
    """Rows of a fit, (n,), less those whose size may be a package's, where others speak of the class."""
    doubted: NDArray[np.bool_] = np.array([PACKAGE in (row or ()) for row in flags], dtype=bool)
    others = ~doubted & np.isin(kind, sorted(STRONG | {JUDGED}))
    return ~doubted if others.any() else np.full(len(kind), True)


def _fit_rows(source: NDArray[np.str_], hashes: NDArray[np.uint64]) -> NDArray[np.intp]:
    """Rows (k,) that the fit takes of n: of each source at most `FIT_ROWS`, those of the lowest hash (n,)."""
    order = np.lexsort((hashes, source))
    _, starts, counts = np.unique(source[order], return_index=True, return_counts=True)
    rank = np.arange(len(source)) - np.repeat(starts, counts)
    return np.sort(order[rank < FIT_ROWS])


def _items(table: pa.Table, licences: Mapping[str, str]) -> bytes:
    known = pa.array([licences[source] for source in table["source"].to_pylist()], pa.string())
    table = table.set_column(table.schema.get_field_index("licence"), "licence", pc.coalesce(table["licence"], known))
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, ITEMS) as writer:
        writer.write_table(table.select(ITEMS.names).cast(ITEMS))
    return bytes(sink.getvalue())


def _nodes(table: pa.Table) -> list[NDArray[np.intp]]:
    """Row numbers (k,) of each node of a table sorted by node."""
    node = _strings(table, "node_id")
    _, starts = np.unique(node, return_index=True)
    return [rows for rows in np.split(np.arange(len(node)), starts[1:]) if len(rows)]


def _axes(table: pa.Table) -> FloatArray:
    """(n, 3) length, width, height in mm, NaN where a row lacks it."""
    columns = [table[f"{axis}_mm"].to_numpy(zero_copy_only=False) for axis in AXES]
    return np.column_stack(columns).astype(float)


def _range_sd(table: pa.Table) -> FloatArray:
    """(n, 3) standard deviations in log mm of stated ranges, NaN without."""
    if table["range_sd"].null_count == table.num_rows:
        return np.full((table.num_rows, 3), np.nan)
    return matrix_of_lists(table["range_sd"])


def _strings(table: pa.Table, column: str) -> NDArray[np.str_]:
    """(n,) a column as text."""
    strings: NDArray[np.str_] = table[column].to_numpy(zero_copy_only=False).astype(str)
    return strings
