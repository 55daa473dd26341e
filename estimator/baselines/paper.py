"""The paper's estimate (section 4.3): s* = argmax of the product of phi_i(s L_i) over candidate scales.

phi_i is a `BayesianGaussianMixture` with n // 3 components over millimetres, fitted to the items of the class, and
degraded to the dimensions whose confidence eta reaches 0.7. As in the paper the likelihood has no Jacobian, objects
are independent, and no object can be an outlier. A second arm takes the authors' own lists in place of our items.
"""

from __future__ import annotations

import time
import tomllib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from estimator.baselines.candidate_search import candidate_scales, estimate_on
from estimator.records.objects import ETA_THRESHOLD, MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import ScaleResult, UpReport
from estimator.results.object_priors import LabelMeaning, meanings
from estimator.results.scale_report import ScaleAnswer, result_of
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted
from metric_base.folders import data_folder
from metric_base.input_files import read_text
from metric_base.statistics import mixture_log_density
from metric_tree.axes import AXES, EXTENTS
from metric_tree.node import Node, UnknownName
from metric_tree.tree import Tree

#: One component for so many items (the authors' released code).
ITEMS_PER_COMPONENT = 3

#: A class of more items is thinned, evenly by a fixed seed: the paper's 244 components for 734 laptops take 4 s to
#: fit and say no more than 50 do.
MOST_ITEMS = 150

#: Of a class with fewer shipped items the fit is drawn from the prior: a mixture of two components is not the paper's.
LEAST_ITEMS = 9

SEED = 0


@dataclass(frozen=True, slots=True, eq=False)
class PaperMixture:
    """A Gaussian mixture over mm: dims (d,), weights (k,), means (k, d), covariances (k, d, d)."""

    dims: tuple[str, ...]
    weights: FloatArray
    means: FloatArray
    covariances: FloatArray

    def log_density(self, sizes_mm: FloatArray, axes: Sequence[int]) -> FloatArray:
        """Log density (g,) of the marginal over `axes` at sizes (g, len(axes))."""
        chosen = np.array(axes)
        covariances = self.covariances[:, chosen[:, None], chosen]  # (k, a, a)
        return mixture_log_density(sizes_mm, self.weights, self.means[:, chosen], covariances)


def paper_result(
    objects: Sequence[MeasuredObject],
    tree: Tree,
    options: EstimateOptions,
    lists: Path | None = None,
    up: UpReport | None = None,
    warnings: Sequence[str] = (),
    seconds: Mapping[str, float] | None = None,
) -> ScaleResult:
    """The scale by the paper's method; `lists` is the authors' folder `scale_metrics` for the second arm.

    up, warnings, seconds : what the geometry found, its warnings and times, handed on.
    """
    by_name = meanings(tree, {item.category for item in objects})
    authors = authors_lists(lists, tree) if lists is not None else None
    started = time.perf_counter()
    mixtures, notes = _mixtures(by_name, authors)
    fitting = time.perf_counter() - started
    started = time.perf_counter()
    answer = _answer(objects, by_name, mixtures, options)
    elapsed = {**(seconds or {}), "fit": fitting, "posterior": time.perf_counter() - started}
    return result_of(objects, tree, by_name, answer, options, up, (*warnings, *notes), elapsed)


def fit_mixture(dims: tuple[str, ...], sizes_mm: FloatArray) -> PaperMixture:
    """The paper's mixture of (n, d) sizes in mm: n // 3 components, at least one."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.mixture import BayesianGaussianMixture

    if len(sizes_mm) > MOST_ITEMS:
        sizes_mm = np.random.default_rng(SEED).permutation(sizes_mm)[:MOST_ITEMS]
    components = max(len(sizes_mm) // ITEMS_PER_COMPONENT, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model = BayesianGaussianMixture(n_components=components, random_state=SEED).fit(sizes_mm)
    return PaperMixture(dims, model.weights_, model.means_, model.covariances_)


def authors_lists(folder: Path, tree: Tree) -> dict[str, tuple[tuple[str, ...], FloatArray]]:
    """The authors' own lists by node id: dims and (n, d) sizes in mm.

    One file per class, without header: three columns are two sides and the height, two columns a lying object's
    sides, one column a height; dining chairs are in inches. Which category a file is, the declaration
    of the same source among our data says.
    """
    if not folder.is_dir():
        raise InputError.at(folder, "--paper-lists", "the authors' folder scale_metrics", Unquoted("no such folder"))
    lists = {}
    for stem, name in _list_names().items():
        path = folder / f"{stem}.csv"
        try:
            node = tree.find(name)
        except UnknownName:
            continue
        if path.is_file():
            lists[node.node_id] = _list(path)
    if not lists:
        raise InputError.at(folder, "--paper-lists", "files such as car.csv", Unquoted("none that the tree knows"))
    return lists


def _list_names() -> dict[str, str]:
    """File stem to category name, from the declaration of the authors' lists."""
    declared = tomllib.loads(read_text(data_folder() / "sources" / "metric_tree_2020.toml"))
    return {
        Path(file).stem: table["category"][-1]
        for table in declared["tables"]
        for file in table["files"]
        if table.get("category")
    }


def _list(path: Path) -> tuple[tuple[str, ...], FloatArray]:
    """Column names (d,) and values (n, d), mm, of one of the authors' lists."""
    try:
        rows = np.array(
            [[float(cell) for cell in line.split(",")] for line in read_text(path).split("\n") if line.strip()]
        )
    except ValueError:
        raise InputError.at(path, "rows", "numbers apart by commas, as many in each line", Unquoted("others")) from None
    sizes = rows * (25.4 if path.stem == "diningchair" else 1.0)
    if sizes.shape[1] == 1:
        return ("height",), sizes
    sides = np.sort(sizes[:, :2], axis=1)[:, ::-1]
    if sizes.shape[1] == 2:
        return ("length", "width"), sides
    return AXES, np.column_stack([sides, sizes[:, 2]])


def _mixtures(
    by_name: Mapping[str, LabelMeaning], authors: Mapping[str, tuple[tuple[str, ...], FloatArray]] | None
) -> tuple[dict[str, PaperMixture], list[str]]:
    """The mixture of each category name, and what to say about those fitted to less than the class's items.

    authors : by node id, dims (d,) and sizes (n, d) in mm.
    """
    mixtures, notes = {}, []
    for name, meaning in by_name.items():
        if meaning.node is None or meaning.prior is None:
            continue
        if authors is not None:
            if meaning.node.node_id in authors:
                mixtures[name] = fit_mixture(*authors[meaning.node.node_id])
            else:
                notes.append(f"category {name!r}: the authors have no list of {meaning.node.node_id}")
            continue
        mixtures[name], drawn = _node_mixture(meaning.node, meaning.prior.dims)
        if drawn:
            notes.append(f"category {name!r}: its rows are not shipped; the paper's fit is to draws from the prior")
    return mixtures, notes


@cache
def _node_mixture(node: Node, dims: tuple[str, ...]) -> tuple[PaperMixture, bool]:
    """The mixture of a node's items; True where they had to be drawn from the prior."""
    sizes = _item_sizes(node, dims)
    drawn = len(sizes) < LEAST_ITEMS
    return fit_mixture(dims, node.prior(dims).sample(MOST_ITEMS, SEED) if drawn else sizes), drawn


def _item_sizes(node: Node, dims: tuple[str, ...]) -> FloatArray:
    """(n, d) sizes in mm of the shipped items that have every dimension."""
    table = node.items()
    if dims[0] in EXTENTS:
        rows = [row for row in table.column("extents_mm").to_pylist() if row and len(row) == 3]
        sizes = np.array(rows, dtype=float).reshape(-1, 3)[:, [EXTENTS.index(name) for name in dims]]
    else:
        sizes = np.column_stack([np.array(table.column(f"{name}_mm").to_pylist(), dtype=float) for name in dims])
    return np.asarray(sizes[np.isfinite(sizes).all(axis=1)])


def _answer(
    objects: Sequence[MeasuredObject],
    by_name: Mapping[str, LabelMeaning],
    mixtures: Mapping[str, PaperMixture],
    options: EstimateOptions,
) -> ScaleAnswer:
    places, used, reasons, sizes = [], [], [], []
    for place, item in enumerate(objects):
        mixture = mixtures.get(item.category)
        names, lengths = _plausible(item, mixture) if mixture is not None else ((), np.zeros(0))
        reason = item.skipped or by_name[item.category].reason
        if reason is None and mixture is None:
            reason = "no list of its class"
        if reason is None and not names:
            reason = f"no dimension of its class with confidence of {ETA_THRESHOLD} or more"
        reasons.append(reason)
        if reason is None and mixture is not None:
            places.append(place)
            used.append(names)
            sizes.append((mixture, [mixture.dims.index(name) for name in names], lengths * 1000))
    if not places:
        return ScaleAnswer(None, places, used, reasons)
    proposed = [float(value) for mixture, axes, mm in sizes for value in (mixture.weights @ mixture.means)[axes] / mm]
    scales = candidate_scales(np.array(proposed))
    log_likelihood = np.stack([mixture.log_density(scales[:, None] * mm, axes) for mixture, axes, mm in sizes])
    return ScaleAnswer(estimate_on(scales, log_likelihood, options.level), places, used, reasons)


def _plausible(item: MeasuredObject, mixture: PaperMixture) -> tuple[tuple[str, ...], FloatArray]:
    """The mixture's dimensions that the object shows with eta of 0.7 or more, and its extents (k,) in scene units.

    A dimension without a confidence is taken as it is; a box whose vertical is unknown has only sorted extents.
    """
    extents, eta = np.asarray(item.extents), np.asarray(item.confidence)
    names: tuple[str, ...] = AXES
    if mixture.dims[0] in EXTENTS:
        order = np.argsort(-np.nan_to_num(extents))
        extents, eta, names = extents[order], eta[order], EXTENTS
    elif not item.vertical_known:
        return (), np.zeros(0)
    with np.errstate(invalid="ignore"):
        good = np.isfinite(extents) & ~(eta < ETA_THRESHOLD)
    chosen = tuple(name for name, ok in zip(names, good, strict=True) if ok and name in mixture.dims)
    return chosen, np.array([extents[names.index(name)] for name in chosen])
