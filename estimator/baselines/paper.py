"""The estimate of the paper (section 4.3): s* = argmax of the product of phi_i(s L_i) over candidate scales.

phi_i is a `BayesianGaussianMixture` with n // 3 components, in millimetres, fitted to the n items of the class and
marginalised to the dimensions with a confidence eta of at least 0.7. As in the paper, the likelihood has no Jacobian,
objects are independent, and no object is an outlier. A second version uses the authors' lists instead of our items.
"""

from __future__ import annotations

import tomllib
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from estimator.baselines.candidate_search import candidate_scales, estimate_on
from estimator.posterior.posterior import Estimate
from estimator.records.objects import ETA_THRESHOLD, MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import ResultContext, ScaleResult
from estimator.results.object_priors import CategoryMatch, EvidenceSet, resolve_categories, selected_evidence
from estimator.results.scale_report import build_result
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted
from metric_base.folders import data_folder
from metric_base.input_files import read_text
from metric_base.progress import stopwatch
from metric_base.statistics import mixture_log_density
from metric_tree.axes import AXES, EXTENTS
from metric_tree.node import Node, UnknownName
from metric_tree.tree import Tree

#: Number of items per component of a mixture (code released by the authors).
ITEMS_PER_COMPONENT = 3
#: Maximum number of items of a class, sampled with a fixed seed: the 244 components that the paper fits to 734 laptops
#: take 4 s and give the same result as 50.
MAX_ITEMS = 150
#: Minimum number of shipped items of a class. With fewer, the mixture is fitted to samples from the prior, because a
#: mixture of two components differs from the paper.
MIN_ITEMS = 9
#: Approximate standard deviation of sizes relative to the smallest mean, if all items have one size along an axis: the
#: error of a stated size.
MIN_RELATIVE_SD = 0.01
#: Millimetres per inch, the unit of a list by the authors.
MM_PER_INCH = 25.4
SEED = 0


@dataclass(frozen=True, slots=True, eq=False)
class PaperMixture:
    """A Gaussian mixture in millimetres."""

    dims: tuple[str, ...]  #: (d,) names of the dimensions.
    weights: FloatArray  #: (k,)
    means: FloatArray  #: (k, d)
    covariances: FloatArray  #: (k, d, d)

    def log_density(self, sizes_mm: FloatArray, axes: Sequence[int]) -> FloatArray:
        """Return the log density (g,) of the marginal over `axes` at sizes (g, len(axes))."""
        chosen = np.array(axes)
        covariances = self.covariances[:, chosen[:, None], chosen]  # (k, a, a)
        return mixture_log_density(sizes_mm, self.weights, self.means[:, chosen], covariances)


def paper_result(
    objects: Sequence[MeasuredObject], tree: Tree, options: EstimateOptions, context: ResultContext | None = None
) -> ScaleResult:
    """Estimate the scale by the method of the paper; parameters as in `scale_of_objects`.

    With `options.paper_lists`, the mixtures are fitted to the authors' lists.
    """
    context = context or ResultContext()
    matches = resolve_categories(tree, {item.category for item in objects})
    authors = None if options.paper_lists is None else authors_lists(options.paper_lists, tree)
    seconds = dict(context.seconds)
    with stopwatch(seconds, "fit"):
        mixtures: dict[str, PaperMixture] = {}
        notes: list[str] = []  # categories whose mixture is not fitted to items of the class
        for name, match in matches.items():
            if match.node is None or match.prior is None:
                continue
            if authors is not None:
                if match.node.node_id in authors:
                    mixtures[name] = fit_mixture(*authors[match.node.node_id])
                else:
                    notes.append(f"category {name!r}: the authors have no list of {match.node.node_id}")
                continue
            mixtures[name], is_sampled = node_mixture(match.node, match.prior.dims)
            if is_sampled:
                notes.append(f"category {name!r}: its rows are not shipped; the paper's fit is to draws from the prior")
    with stopwatch(seconds, "posterior"):
        evidence, estimate = _estimate(objects, matches, mixtures, options.level)
    status, reason = ("unresolved", None) if estimate is None else (estimate.status, estimate.reason)
    return build_result(
        evidence, estimate, tree, options, context, status=status, reason=reason, notes=notes, seconds=seconds
    )


def fit_mixture(dims: tuple[str, ...], sizes_mm: FloatArray) -> PaperMixture:
    """Fit the mixture of the paper to sizes (n, d) in mm, with n // 3 components, at least one.

    If the items have one size along an axis, or scikit-learn finds no covariance, their standard
    deviation is about `MIN_RELATIVE_SD`.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.mixture import BayesianGaussianMixture

    if len(sizes_mm) > MAX_ITEMS:
        sizes_mm = np.random.default_rng(SEED).permutation(sizes_mm)[:MAX_ITEMS]
    components = max(len(sizes_mm) // ITEMS_PER_COMPONENT, 1)
    has_spread = bool((sizes_mm.std(axis=0) >= MIN_RELATIVE_SD * sizes_mm.mean(axis=0)).all())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model = None
        with suppress(ValueError):  # of scikit-learn: an ill-defined empirical covariance
            if has_spread:
                model = BayesianGaussianMixture(n_components=components, random_state=SEED).fit(sizes_mm)
        if model is None:
            floor = float((MIN_RELATIVE_SD * sizes_mm.mean(axis=0).min()) ** 2)
            prior = np.atleast_2d(np.cov(sizes_mm.T, bias=True)) + floor * np.eye(len(dims))
            options = {"covariance_prior": prior, "reg_covar": floor, "random_state": SEED}
            rows = np.repeat(sizes_mm, 2, axis=0) if len(sizes_mm) == 1 else sizes_mm
            model = BayesianGaussianMixture(n_components=components, **options).fit(rows)
    return PaperMixture(dims, model.weights_, model.means_, model.covariances_)


def authors_lists(folder: Path, tree: Tree) -> dict[str, tuple[tuple[str, ...], FloatArray]]:
    """Read the authors' lists: for each node id, the dimensions (d,) and the sizes (n, d) in mm.

    Each class has a CSV file without a header. Three columns are two sides and the height, two columns are the sides of
    a lying object, one column is a height. The category of a file is that in the declaration of the same source in our
    data.
    """
    if not folder.is_dir():
        raise InputError.at(folder, "--paper-lists", "the authors' folder scale_metrics", Unquoted("no such folder"))
    declared = tomllib.loads(read_text(data_folder() / "sources" / "metric_tree_2020.toml"))
    names = {
        Path(file).stem: table["category"][-1]
        for table in declared["tables"]
        for file in table["files"]
        if table.get("category")
    }
    lists: dict[str, tuple[tuple[str, ...], FloatArray]] = {}
    for stem, name in names.items():
        path = folder / f"{stem}.csv"
        try:
            node = tree.find(name)
        except UnknownName:
            continue
        if not path.is_file():
            continue
        lines = [line for line in read_text(path).split("\n") if line.strip()]
        try:
            rows = np.array([[float(cell) for cell in line.split(",")] for line in lines])
        except ValueError:
            expected = "numbers separated by commas, the same number in each line"
            raise InputError.at(path, "rows", expected, Unquoted("others")) from None
        sizes = rows * (MM_PER_INCH if stem == "diningchair" else 1.0)
        sides = np.sort(sizes[:, :2], axis=1)[:, ::-1]
        if sizes.shape[1] == 1:
            lists[node.node_id] = ("height",), sizes
        elif sizes.shape[1] == 2:
            lists[node.node_id] = ("length", "width"), sides
        else:
            lists[node.node_id] = AXES, np.column_stack([sides, sizes[:, 2]])
    if not lists:
        raise InputError.at(folder, "--paper-lists", "files such as car.csv", Unquoted("none that the tree knows"))
    return lists


@cache
def node_mixture(node: Node, dims: tuple[str, ...]) -> tuple[PaperMixture, bool]:
    """Return the mixture of the items of a node, and whether they are samples from the prior.

    The items are the shipped ones that have every dimension.
    """
    table = node.items()
    if dims[0] in EXTENTS:
        rows = [row for row in table.column("extents_mm").to_pylist() if row and len(row) == 3]
        sizes = np.array(rows, dtype=float).reshape(-1, 3)[:, [EXTENTS.index(name) for name in dims]]
    else:
        sizes = np.column_stack([np.array(table.column(f"{name}_mm").to_pylist(), dtype=float) for name in dims])
    sizes = sizes[np.isfinite(sizes).all(axis=1)]
    is_sampled = len(sizes) < MIN_ITEMS
    return fit_mixture(dims, node.prior(dims).sample(MAX_ITEMS, SEED) if is_sampled else sizes), is_sampled


def _estimate(
    objects: Sequence[MeasuredObject],
    matches: Mapping[str, CategoryMatch],
    mixtures: Mapping[str, PaperMixture],
    level: float,
) -> tuple[EvidenceSet, Estimate | None]:
    """Return the objects that are used, and the estimate from them; None without any."""
    reasons: list[str | None] = []
    used: dict[int, tuple[str, ...]] = {}
    sizes: list[tuple[PaperMixture, list[int], FloatArray]] = []  # mixture, its axes (a,), sizes (a,) in mm at scale 1
    for index, item in enumerate(objects):
        mixture = mixtures.get(item.category)
        names, lengths = plausible_dimensions(item, mixture) if mixture is not None else ((), np.zeros(0))
        reason = item.skipped or matches[item.category].reason
        if reason is None and mixture is None:
            reason = "no list of its class"
        if reason is None and not names:
            reason = f"no dimension of its class with confidence of {ETA_THRESHOLD} or more"
        reasons.append(reason)
        if reason is None and mixture is not None:
            used[index] = names
            sizes.append((mixture, [mixture.dims.index(name) for name in names], lengths * 1000))
    evidence = selected_evidence(objects, matches, reasons, used)
    if not used:
        return evidence, None
    proposed = [float(value) for mixture, axes, mm in sizes for value in (mixture.weights @ mixture.means)[axes] / mm]
    scales = candidate_scales(np.array(proposed))
    log_likelihood = np.stack([mixture.log_density(scales[:, None] * mm, axes) for mixture, axes, mm in sizes])
    return evidence, estimate_on(scales, log_likelihood, level)


def plausible_dimensions(item: MeasuredObject, mixture: PaperMixture) -> tuple[tuple[str, ...], FloatArray]:
    """Return the dimensions of the mixture with a confidence of at least 0.7, and the extents (k,) in scene units.

    A dimension without a confidence is used. A box without a vertical has only sorted extents.
    """
    extents, eta = np.asarray(item.extents), np.asarray(item.confidence)
    names: tuple[str, ...] = AXES
    if mixture.dims[0] in EXTENTS:
        order = np.argsort(-np.nan_to_num(extents))
        extents, eta, names = extents[order], eta[order], EXTENTS
    elif not item.vertical_known:
        return (), np.zeros(0)
    with np.errstate(invalid="ignore"):
        is_plausible = np.isfinite(extents) & ~(eta < ETA_THRESHOLD)
    chosen = tuple(name for name, ok in zip(names, is_plausible, strict=True) if ok and name in mixture.dims)
    return chosen, np.array([extents[names.index(name)] for name in chosen])
