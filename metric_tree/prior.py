"""The size prior of a category: a log-normal mixture over millimetres (paper 3; docs/explanation/priors.md).

The density of an object of an unknown source is, over x = ln(size in mm),

    p(x) = sum_k w_k N(x; m_k, S_k + B)

with S_k the covariance within a source and B the covariance between sources, so that a marginal only deletes rows and
columns. This module imports only NumPy, because queries load it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError, UnknownKey
from metric_base.statistics import mixture_log_density
from metric_tree.tiers import TIERS, Evidence, tier_of_shares

if TYPE_CHECKING:
    from metric_tree.context import Context, ContextModel, Where

FAMILY = "lognormal-mixture"
#: Fields of a prior that are arrays.
ARRAYS = ("weights", "means", "covariances", "shared_covariance")
#: Maximum |ln mm| of a mean: 10,000 km, or a billionth of a millimetre.
MAX_ABS_LOG_MM = 23.0
#: Quantiles of tables, pages and commands: the 90 % interval, the quartiles and the median.
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
#: Quantiles of tables without space for the quartiles, and the index of the median in `QUANTILES`.
INTERVAL_QUANTILES, MEDIAN = QUANTILES[::2], QUANTILES.index(0.5)
#: Half-width of the bracket of a quantile in standard deviations of a component; 2e-19 of a Gaussian are outside.
BRACKET_SD = 9.0
#: Maximum number of steps to a quantile. Bisection alone, 18 sd / 2^60, reaches the resolution of a double.
MAX_NEWTON_STEPS = 60
#: Minimum step of ln size, 1 nm of a metre. In a far tail steps are not much smaller.
MIN_STEP_LOG = 1e-9
#: Minimum relative change of a size that a note reports; no source states sizes to 0.5 %.
MIN_REPORTED_CHANGE = 0.005
#: Minimum standard deviation of ln size of the shared error in any direction. A class with one source, or whose sources
#: agree by chance, may still have an error of 3 % in a scene, the minimum of the fit as well.
FLOOR_SD = 0.03
#: Shared error of classes whose sources have no known disagreement (B is below the minimum in every direction): 8 %
#: common to all dimensions and 5 % for each, the errors of the cars of one continent on the streets of another.
LONE_COMMON_SD, LONE_OWN_SD = 0.08, 0.05
#: Fraction of the variance of a stated size (a judged range, a state, a variant) that objects of one scene have in
#: common, 0 to 1: a range covers the complete class.
STATED_SHARED = 0.35
#: Kinds of evidence of the column `share_by_kind`.
SHARED_KINDS = (
    "product", "measured", "standard", "norm", "statistic", "asset", "museum", "default", "judged",
)  # fmt: skip
#: Minimum Ashman's D of two distinct Gaussians (Ashman, Bird and Zepf 1994).
MIN_ASHMAN_D = 2.0
#: Minimum weight of the second kind of object of a class with distinct components, 0 to 1.
MIN_COMPONENT_SHARE = 0.1
#: Minimum ratio of the sizes of two kinds of object; forks for fish and for meat are one kind.
MIN_SIZE_RATIO = 1.5


class UnknownDimension(UnknownKey):
    """A dimension that the prior does not have; the message lists the existing ones."""


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """A mixture of k Gaussians over the natural log of millimetres, in d dimensions.

    The density of a new object of an unknown source is the mixture with `covariances + shared_covariance`. `length` is
    the longer and `width` the shorter horizontal side, `height` the vertical one, in the ordinary pose; people use
    other names (`metric_tree.reports.stated_axes`): the length of a sofa is its width.
    """

    node_id: str
    dims: tuple[str, ...]  #: (d,)
    weights: FloatArray  #: (k,)
    means: FloatArray  #: (k, d)
    covariances: FloatArray  #: (k, d, d) within a source.
    shared_covariance: FloatArray  #: (d, d) between sources, B.
    n: int  #: Number of items.
    n_sources: int
    share_by_kind: dict[str, float]  #: Fraction of the weight of the fit by kind of evidence.
    borrowed: float  #: Fraction of the covariance that comes from the parent node, 0 to 1.
    heldout_log_density: float | None = None  #: Mean log density over ln mm of held-out rows.
    sameness: float | None = None  #: Intraclass correlation of the objects of one room, 0 to 1.
    sameness_sd: float | None = None
    contexts: tuple[Context, ...] = ()  #: Offsets of regions and years.
    note: str | None = None  #: Effect of `in_context`.
    tier: str = ""  #: One of `metric_tree.tiers.TIERS`; computed for releases before 3.0.0.
    evidence: Evidence | None = None  #: Counts of the tier.
    norm: str | None = None  #: Document and clause that fix the size.

    def __post_init__(self) -> None:
        if not self.tier:
            tier = tier_of_shares(self.share_by_kind, self.n, self.n_sources, self.borrowed)
            object.__setattr__(self, "tier", tier)
        _expect(self.node_id, "tier", self.tier in TIERS, f"one of {', '.join(TIERS)}", self.tier)
        k, d = len(self.weights), len(self.dims)
        _expect(self.node_id, "weights", k > 0 and abs(float(np.sum(self.weights)) - 1) < 1e-6, "sum 1", self.weights)
        shapes = {"means": (k, d), "covariances": (k, d, d), "shared_covariance": (d, d)}
        for name, shape in shapes.items():
            actual = np.shape(getattr(self, name))
            _expect(self.node_id, name, actual == shape, f"shape {shape}", actual)

    def log_density(self, sizes_mm: FloatArray) -> FloatArray:
        """Return the natural log of the density over ln mm.

        Parameters
        ----------
        sizes_mm : (n, d) float
            Sizes in the order of `dims`.

        Returns
        -------
        (n,) float
            Finite for positive sizes. Subtract the sum of ln(size) for the density over mm.
        """
        x = np.log(np.atleast_2d(np.asarray(sizes_mm, dtype=float)))  # (n, d)
        return mixture_log_density(x, self.weights, self.means, self._covariances)

    def marginal(self, dims: Sequence[str]) -> Prior:
        """Return the exact marginal over one or several `dims`, in their order.

        Raises
        ------
        UnknownDimension
            The prior lacks a dimension; the message lists the existing ones.
        """
        dims = (dims,) if isinstance(dims, str) else tuple(dims)
        unknown = [name for name in dims if name not in self.dims]
        if unknown or not dims or len(set(dims)) != len(dims):
            wanted = ", ".join(dims) or "none"
            raise UnknownDimension(f"{self.node_id}: dims: expected some of {', '.join(self.dims)}; found {wanted}")
        axes = np.array([self.dims.index(name) for name in dims])
        return replace(
            self,
            dims=tuple(dims),
            means=self.means[:, axes],
            covariances=self.covariances[:, axes[:, None], axes],
            shared_covariance=self.shared_covariance[axes[:, None], axes],
            heldout_log_density=None if tuple(dims) != self.dims else self.heldout_log_density,
            contexts=tuple(one.axes(axes.tolist()) for one in self.contexts),
        )

    def in_context(self, where: Where, model: ContextModel | None) -> Prior:
        """Return the prior of objects of a region and a year; `note` states the effect.

        The means are shifted by the effect of the context, and B is reduced by its explained variance, which is at most
        the fractions of region and year. Without data close to the context the prior is unchanged.
        """
        if not self.contexts or model is None:
            return replace(self, note=f"{where}: nothing known by region or year, so that the plain prior holds")
        from metric_tree.context import context_effect, known_contexts

        known = known_contexts((one.region, one.year) for one in self.contexts)
        if not known.covers(where, model.years):
            return replace(self, note=f"{where}: nothing known, so that the plain prior holds; known: {known}")
        effect = context_effect(self.contexts, np.diagonal(self.shared_covariance), where, model)
        scale = np.sqrt(effect.factor)
        changes = []
        for dim, change in zip(self.dims, np.expm1(effect.offset), strict=True):
            changes.append(f"{dim} {change:+.1%}" if abs(change) >= MIN_REPORTED_CHANGE else f"{dim} unchanged")
        return replace(
            self,
            means=self.means + effect.offset,
            shared_covariance=self.shared_covariance * np.outer(scale, scale),
            heldout_log_density=None,
            note=f"{where}: {', '.join(changes)} against the plain prior",
        )

    def quantile(self, q: float) -> FloatArray:
        """Return the quantile `q` (0 < q < 1) of the marginal of each dimension, (d,) in mm."""
        row: FloatArray = self.quantiles((q,))[0]
        return row

    def quantiles(self, levels: Sequence[float]) -> FloatArray:
        """Return the quantiles at the levels (0 < q < 1) of the marginal of each dimension, (q, d) in mm."""
        if wrong := [q for q in levels if not 0 < q < 1]:
            raise InputError(f"quantile: expected a number between 0 and 1; found {wrong[0]!r}")
        sd = np.sqrt(np.diagonal(self._covariances, axis1=1, axis2=2))  # (k, d)
        columns = []
        for means, sds in zip(self.means.T.tolist(), sd.T.tolist(), strict=True):
            parts = list(zip(self.weights.tolist(), means, sds, strict=True))
            columns.append([_mixture_quantile(q, parts) for q in levels])
        return np.asarray(np.exp(np.array(columns).T))

    def interval(self, level: float) -> FloatArray:
        """Return the equal-tailed interval of the marginal of each dimension with probability `level`, (d, 2) in mm."""
        if not 0 < level < 1:
            raise InputError(f"level: expected a number between 0 and 1; found {level!r}")
        return self.quantiles(((1 - level) / 2, (1 + level) / 2)).T

    def log_sd(self) -> FloatArray:
        """Return the standard deviation of ln size of an object of an unknown source in each dimension, (d,).

        variance = sum_k w_k (covariance_k + shared + (mean_k - mean)^2)
        """
        mean = self.weights @ self.means
        within = np.diagonal(self._covariances, axis1=1, axis2=2)
        return np.asarray(np.sqrt(self.weights @ (within + (self.means - mean) ** 2)))

    def disagreement(self) -> FloatArray:
        """Return the covariance of the error that all objects of the class in one scene share, (d, d) in ln mm.

        This is `shared_covariance` with a standard deviation of at least `FLOOR_SD` in every direction. If the sources
        of the class have no known disagreement, it has the standard deviations `LONE_COMMON_SD` and `LONE_OWN_SD`. The
        tolerance of a norm is used unchanged.
        """
        if self.tier == "norm":
            return self.shared_covariance
        values, vectors = np.linalg.eigh(self.shared_covariance)
        if values.max() < FLOOR_SD**2:
            values, vectors = np.linalg.eigh(LONE_COMMON_SD**2 + LONE_OWN_SD**2 * np.eye(len(self.dims)))
        return np.asarray((vectors * np.maximum(values, FLOOR_SD**2)) @ vectors.T)

    def sample(self, n: int, seed: int) -> FloatArray:
        """Return `n` random objects of an unknown source, (n, d) in mm; equal for equal seeds."""
        generator = np.random.default_rng(seed)
        component = generator.choice(len(self.weights), size=n, p=self.weights / self.weights.sum())
        lower = np.linalg.cholesky(self._covariances)  # (k, d, d)
        white = generator.standard_normal((n, len(self.dims)))
        sizes: FloatArray = np.exp(self.means[component] + np.einsum("nij,nj->ni", lower[component], white))
        return sizes

    def row(self) -> dict[str, Any]:
        """Return the prior as a row of `metric_tree.release.schema.PRIORS`."""
        row = {name: getattr(self, name) for name in self.__slots__ if name != "note"}
        row |= {name: row[name].tolist() for name in ARRAYS}
        row |= {"family": FAMILY, "dims": list(self.dims), "contexts": [one.row() for one in self.contexts]}
        row["share_by_kind"] = {kind: self.share_by_kind.get(kind) for kind in SHARED_KINDS}
        row["evidence"] = self.evidence.record() if self.evidence else None
        return row

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> Prior:
        """Return the prior of a row of `metric_tree.release.schema.PRIORS`.

        Raises
        ------
        InputError
            The family is unknown, or the arrays have wrong shapes or values.
        """
        node_id = row["node_id"]
        _expect(node_id, "family", row["family"] == FAMILY, FAMILY, row["family"])
        contexts: tuple[Context, ...] = ()
        if row.get("contexts"):
            from metric_tree.context import Context  # takes several milliseconds, in queries without a context

            contexts = tuple(map(Context.of_row, row["contexts"]))
        try:
            values: dict[str, Any] = {name: row.get(name) for name in cls.__slots__ if name != "note"}
            values |= {name: np.array(row[name], dtype=float) for name in ARRAYS}
            values |= {"dims": tuple(row["dims"]), "contexts": contexts, "tier": row.get("tier") or ""}
            # a list of pairs in a release before 3.0.0
            shares = dict(row["share_by_kind"]).items()
            values["share_by_kind"] = {kind: share for kind, share in shares if share is not None}
            values["evidence"] = Evidence(**row["evidence"]) if row.get("evidence") else None
            prior = cls(**values)
        except InputError:
            raise
        except (TypeError, ValueError, KeyError) as error:
            raise InputError(f"{node_id}: prior: expected arrays of numbers; found {error}") from None
        for name in ARRAYS:
            array = getattr(prior, name)
            _expect(node_id, name, bool(np.isfinite(array).all()), "finite numbers", array)
        within = bool((np.abs(prior.means) <= MAX_ABS_LOG_MM).all())
        _expect(node_id, "means", within, f"ln mm from -{MAX_ABS_LOG_MM:g} to {MAX_ABS_LOG_MM:g}", prior.means)
        eigenvalues = np.linalg.eigvalsh(prior._covariances)
        _expect(node_id, "covariances", bool((eigenvalues > 0).all()), "positive definite ones", prior.covariances)
        return prior

    @property
    def _covariances(self) -> FloatArray:
        """Covariances of the components for an object of an unknown source, (k, d, d)."""
        return self.covariances + self.shared_covariance


def _mixture_quantile(level: float, parts: Sequence[tuple[float, float, float]]) -> float:
    """Return a quantile of a mixture of (weight, mean, sd) by Newton's method, with bisection outside the bracket.

    Plain floats take a fifth of the time of NumPy for the few levels and components of a query.
    """
    low = min(mean - BRACKET_SD * sd for _, mean, sd in parts)
    high = max(mean + BRACKET_SD * sd for _, mean, sd in parts)
    x = sum(weight * mean for weight, mean, _ in parts)
    for _ in range(MAX_NEWTON_STEPS):
        excess, density = -level, 0.0
        for weight, mean, sd in parts:
            z = (x - mean) / sd
            excess += weight * 0.5 * (1 + math.erf(z * math.sqrt(0.5)))
            density += weight / sd * math.exp(-0.5 * z * z)
        low, high = (x, high) if excess < 0 else (low, x)
        following = x - excess * math.sqrt(2 * math.pi) / density if density > 0 else math.inf
        if not low <= following <= high:
            following = (low + high) / 2
        step, x = abs(following - x), following
        if step < MIN_STEP_LOG:
            break
    return x


def _expect(node_id: str, name: str, holds: bool, expected: str, value: object) -> None:
    if not holds:
        raise InputError(f"prior of {node_id}: {name}: expected {expected}; found {value}")


def has_distinct_components(prior: Prior) -> bool:
    """Return True if two components of a prior are clearly separated: two kinds of object with one name."""
    if len(prior.weights) < 2:
        return False
    centre = prior.means.mean(axis=1)  # ln of the geometric mean size
    sd = np.sqrt(prior.covariances.mean(axis=(1, 2)))
    distance = np.abs(centre[:, None] - centre)
    d = np.sqrt(2) * distance / np.hypot(sd[:, None], sd)
    is_frequent = np.minimum(prior.weights[:, None], prior.weights) >= MIN_COMPONENT_SHARE
    return bool(((d > MIN_ASHMAN_D) & is_frequent & (distance > np.log(MIN_SIZE_RATIO))).any())
