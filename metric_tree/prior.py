"""The size prior of a category: a log-normal mixture over millimetres (paper 3; docs/explanation/priors.md).

The density of an object of an unknown source is, over x = ln(size in mm),

    p(x) = sum_k w_k N(x; m_k, S_k + B)

with S_k the spread within a source and B the covariance between sources, so that a marginal only deletes rows and
columns. Importing this module needs NumPy alone: a query stays light.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.statistics import mixture_log_density
from metric_tree.tiers import TIERS, Evidence, tier_of_shares

if TYPE_CHECKING:
    from metric_tree.context import Context, ContextModel, Where

FAMILY = "lognormal-mixture"
#: Largest |ln mm| of a mean: ten thousand kilometres, and a billionth of a millimetre.
MAX_ABS_LOG_MM = 23.0
#: What every table, page and answer shows: the ends of the 90 % interval, the quartiles and the median.
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
#: Those of a table without room for the quartiles, and the place of the median among all.
INTERVAL_QUANTILES, MEDIAN = QUANTILES[::2], QUANTILES.index(0.5)
#: Half-width of the bracket of a quantile in component standard deviations: holds all but 2e-19 of a Gaussian.
BRACKET_SD = 9.0
#: Most steps to a quantile: halvings alone, 18 sd / 2^60, reach the resolution of a double for any spread met here.
MAX_NEWTON_STEPS = 60
#: A step of ln size that no longer matters: a nanometre in a metre. Far out in a tail no step is much finer.
LEAST_STEP = 1e-9
#: A context that changes a size by less leaves it unchanged: half a percent is below what any source states.
MIN_REPORTED_CHANGE = 0.005
#: Smallest standard deviation of the shared error in any direction, natural log. A class whose sources agree by
#: chance, or that has one source only, may still be 3 % off in a scene: the floor that the fit puts on spreads too.
FLOOR_SD = 0.03
#: Where the release says nothing of how a class's sources disagree (its B is under the floor in every direction): an
#: error of 8 % common to all dimensions and of 5 % in each, what cars of one continent are off on another's streets.
LONE_COMMON_SD, LONE_OWN_SD = 0.08, 0.05
#: Kinds of evidence of which a row has the share of the fit's weight.
SHARED_KINDS = (
    "product", "measured", "standard", "norm", "statistic", "asset", "museum", "default", "judged",
)  # fmt: skip
#: Ashman's D above which two Gaussians are cleanly parted (Ashman, Bird and Zepf 1994 give 2).
MIN_ASHMAN_D = 2.0
#: A second kind of object makes up at least this share of a mixed class.
MIN_COMPONENT_SHARE = 0.1
#: Two kinds of one category differ by half in size or more; cutlery for fish and meat is no mixed class.
MIN_SIZE_RATIO = 1.5


class UnknownDimension(InputError, KeyError):
    """A dimension that the prior does not have; the message names what exists."""

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """A mixture of Gaussians over the natural log of millimetres.

    dims : names of the d axes; weights : (k,); means : (k, d); covariances : (k, d, d) within a source;
    shared_covariance : (d, d) between sources. The density of a new object of unknown source is the mixture
    with covariances + shared_covariance. sameness : share of the variance within a source that the objects of one room
    have in common, 0 to 1, with its standard deviation; None in a release that does not say. contexts : how objects of
    some regions and years differ, for `in_context`; note : what that did. tier : what the size rests on, one of
    `metric_tree.tiers.TIERS`, by the row's shares where a release is too old to say; evidence : the counts behind it;
    norm : the document and clause that fix the size.
    """

    node_id: str
    dims: tuple[str, ...]
    weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    shared_covariance: FloatArray
    n: int
    n_sources: int
    share_by_kind: dict[str, float]
    borrowed: float
    heldout_log_density: float | None = None
    sameness: float | None = None
    sameness_sd: float | None = None
    contexts: tuple[Context, ...] = ()
    note: str | None = None
    tier: str = ""
    evidence: Evidence | None = None
    norm: str | None = None

    def __post_init__(self) -> None:
        if not self.tier:
            tier = tier_of_shares(self.share_by_kind, self.n, self.n_sources, self.borrowed)
            object.__setattr__(self, "tier", tier)
        _expect(self.node_id, "tier", self.tier in TIERS, f"one of {', '.join(TIERS)}", self.tier)
        k, d = len(self.weights), len(self.dims)
        _expect(self.node_id, "weights", k > 0 and abs(float(np.sum(self.weights)) - 1) < 1e-6, "sum 1", self.weights)
        shapes = {"means": (k, d), "covariances": (k, d, d), "shared_covariance": (d, d)}
        for name, shape in shapes.items():
            own = np.shape(getattr(self, name))
            _expect(self.node_id, name, own == shape, f"shape {shape}", own)

    def log_density(self, sizes_mm: FloatArray) -> FloatArray:
        """Natural log of the density over log mm.

        Parameters
        ----------
        sizes_mm : (n, d) float, in the order of `dims`

        Returns
        -------
        (n,) float; -inf nowhere for positive sizes. The density over mm is this minus the sum of ln(size).
        """
        x = np.log(np.atleast_2d(np.asarray(sizes_mm, dtype=float)))  # (n, d)
        return mixture_log_density(x, self.weights, self.means, self._covariances)

    def marginal(self, dims: Sequence[str]) -> Prior:
        """The exact marginal over `dims`, in the order given; one name may stand alone.

        Raises
        ------
        UnknownDimension
            One of them is not among the prior's; the message names what exists.
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
        """The prior of objects of a region and a year: moved by what is known of these, B left with what is not.

        Its interval is never narrower than B allows without the shares of region and year; without data near the
        context it is this prior. `note` says which.
        """
        if not self.contexts or model is None:
            return replace(self, note=f"{where}: nothing known by region or year, so that the plain prior holds")
        from metric_tree.context import context_effect, known_contexts

        known = known_contexts(self.contexts)
        if not known.covers(where, model.years):
            return replace(self, note=f"{where}: nothing known, so that the plain prior holds; known: {known}")
        effect = context_effect(self.contexts, np.diagonal(self.shared_covariance), where, model)
        part = np.sqrt(effect.factor)
        moved = ", ".join(f"{dim} {_change(by)}" for dim, by in zip(self.dims, effect.offset, strict=True))
        return replace(
            self,
            means=self.means + effect.offset,
            shared_covariance=self.shared_covariance * np.outer(part, part),
            heldout_log_density=None,
            note=f"{where}: {moved} against the plain prior",
        )

    def quantile(self, q: float) -> FloatArray:
        """Quantile `q` (0 < q < 1) of each dimension's own marginal, (d,) in mm."""
        row: FloatArray = self.quantiles((q,))[0]
        return row

    def quantiles(self, levels: Sequence[float]) -> FloatArray:
        """The quantile of each dimension's own marginal at each of the levels (0 < q < 1), (q, d) in mm."""
        if wrong := [q for q in levels if not 0 < q < 1]:
            raise InputError(f"quantile: expected a number between 0 and 1; found {wrong[0]!r}")
        sd = np.sqrt(np.diagonal(self._covariances, axis1=1, axis2=2))  # (k, d)
        return np.asarray(np.exp(_mixture_quantiles(levels, self.weights, self.means, sd)))

    def interval(self, level: float) -> FloatArray:
        """Equal-tailed interval that holds `level` of each dimension's marginal, (d, 2) in mm."""
        if not 0 < level < 1:
            raise InputError(f"level: expected a number between 0 and 1; found {level!r}")
        return self.quantiles(((1 - level) / 2, (1 + level) / 2)).T

    def log_sd(self) -> FloatArray:
        """Standard deviation of ln size of an object of unknown source in each dimension, (d,).

        variance = sum_k w_k (covariance_k + shared + (mean_k - mean)^2)
        """
        mean = self.weights @ self.means
        within = np.diagonal(self._covariances, axis1=1, axis2=2)
        return np.asarray(np.sqrt(self.weights @ (within + (self.means - mean) ** 2)))

    def disagreement(self) -> FloatArray:
        """Covariance of the error that all objects of the class in one scene share, (d, d) in ln mm.

        It is `shared_covariance` with no standard deviation under `FLOOR_SD` in any direction; a stand-in where the
        release knows of no disagreement between sources at all. A norm's tolerance is what it says.
        """
        if self.tier == "norm":
            return self.shared_covariance
        values, vectors = np.linalg.eigh(self.shared_covariance)
        if values.max() < FLOOR_SD**2:
            values, vectors = np.linalg.eigh(LONE_COMMON_SD**2 + LONE_OWN_SD**2 * np.eye(len(self.dims)))
        return np.asarray((vectors * np.maximum(values, FLOOR_SD**2)) @ vectors.T)

    def sample(self, n: int, seed: int) -> FloatArray:
        """`n` objects of unknown source, (n, d) in mm; the same for the same seed."""
        generator = np.random.default_rng(seed)
        component = generator.choice(len(self.weights), size=n, p=self.weights / self.weights.sum())
        lower = np.linalg.cholesky(self._covariances)  # (k, d, d)
        white = generator.standard_normal((n, len(self.dims)))
        sizes: FloatArray = np.exp(self.means[component] + np.einsum("nij,nj->ni", lower[component], white))
        return sizes

    def row(self) -> dict[str, Any]:
        """The prior as one row of `metric_tree.release.schema.PRIORS`."""
        return {
            "node_id": self.node_id,
            "dims": list(self.dims),
            "family": FAMILY,
            "weights": self.weights.tolist(),
            "means": self.means.tolist(),
            "covariances": self.covariances.tolist(),
            "shared_covariance": self.shared_covariance.tolist(),
            "n": self.n,
            "n_sources": self.n_sources,
            "share_by_kind": {kind: self.share_by_kind.get(kind) for kind in SHARED_KINDS},
            "borrowed": self.borrowed,
            "heldout_log_density": self.heldout_log_density,
            "sameness": self.sameness,
            "sameness_sd": self.sameness_sd,
            "contexts": [one.row() for one in self.contexts],
            "tier": self.tier,
            "evidence": self.evidence.record() if self.evidence else None,
            "norm": self.norm,
        }

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> Prior:
        """The prior of a row of `metric_tree.release.schema.PRIORS`.

        Raises
        ------
        InputError
            The row is of another family, or its arrays do not fit together.
        """
        node_id = row["node_id"]
        _expect(node_id, "family", row["family"] == FAMILY, FAMILY, row["family"])
        try:
            prior = cls._of_row(row)
        except (TypeError, ValueError, KeyError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"{node_id}: prior: expected arrays of numbers; found {error}") from None
        for name in ("weights", "means", "covariances", "shared_covariance"):
            values = getattr(prior, name)
            _expect(node_id, name, bool(np.isfinite(values).all()), "finite numbers", values)
        within = bool((np.abs(prior.means) <= MAX_ABS_LOG_MM).all())
        _expect(node_id, "means", within, f"ln mm from -{MAX_ABS_LOG_MM:g} to {MAX_ABS_LOG_MM:g}", prior.means)
        spreads = np.linalg.eigvalsh(prior._covariances)
        _expect(node_id, "covariances", bool((spreads > 0).all()), "positive definite ones", prior.covariances)
        return prior

    @classmethod
    def _of_row(cls, row: Mapping[str, Any]) -> Prior:
        return cls(
            node_id=row["node_id"],
            dims=tuple(row["dims"]),
            weights=np.array(row["weights"], dtype=float),
            means=np.array(row["means"], dtype=float),
            covariances=np.array(row["covariances"], dtype=float),
            shared_covariance=np.array(row["shared_covariance"], dtype=float),
            n=row["n"],
            n_sources=row["n_sources"],
            # pairs in a release older than 3.0.0
            share_by_kind={kind: share for kind, share in dict(row["share_by_kind"]).items() if share is not None},
            borrowed=row["borrowed"],
            heldout_log_density=row["heldout_log_density"],
            sameness=row.get("sameness"),
            sameness_sd=row.get("sameness_sd"),
            contexts=_contexts(row.get("contexts") or ()),
            tier=row.get("tier") or "",
            evidence=Evidence.of_record(row["evidence"]) if row.get("evidence") else None,
            norm=row.get("norm"),
        )

    @property
    def _covariances(self) -> FloatArray:
        """Component covariances of an object of unknown source, (k, d, d)."""
        return self.covariances + self.shared_covariance


def _contexts(rows: Sequence[Mapping[str, Any]]) -> tuple[Context, ...]:
    if not rows:
        return ()
    from metric_tree.context import Context  # several milliseconds of a query that asks for no context

    return tuple(map(Context.of_row, rows))


def _mixture_quantiles(levels: Sequence[float], weights: FloatArray, means: FloatArray, sd: FloatArray) -> FloatArray:
    """Quantiles (q, d) of mixtures of one dimension each: weights (k,), means and standard deviations (k, d)."""
    # plain floats: for the few levels of a question they take a fifth of the time of NumPy's steps over small arrays
    columns = []
    for own_means, own_sd in zip(means.T.tolist(), sd.T.tolist(), strict=True):
        parts = list(zip(weights.tolist(), own_means, own_sd, strict=True))
        columns.append([_mixture_quantile(q, parts) for q in levels])
    return np.array(columns).T


def _mixture_quantile(level: float, parts: Sequence[tuple[float, float, float]]) -> float:
    """The quantile of a mixture of (weight, mean, sd) by Newton's steps; a halving where one leaves the bracket."""
    low = min(mean - BRACKET_SD * sd for _, mean, sd in parts)
    high = max(mean + BRACKET_SD * sd for _, mean, sd in parts)
    place = sum(weight * mean for weight, mean, _ in parts)
    for _ in range(MAX_NEWTON_STEPS):
        excess, density = -level, 0.0
        for weight, mean, sd in parts:
            z = (place - mean) / sd
            excess += weight * 0.5 * (1 + math.erf(z * math.sqrt(0.5)))
            density += weight / sd * math.exp(-0.5 * z * z)
        low, high = (place, high) if excess < 0 else (low, place)
        following = place - excess * math.sqrt(2 * math.pi) / density if density > 0 else math.inf
        if not low <= following <= high:
            following = (low + high) / 2
        step, place = abs(following - place), following
        if step < LEAST_STEP:
            break
    return place


def _change(offset: float) -> str:
    """A change of ln size in words."""
    return f"{np.expm1(offset):+.1%}" if abs(np.expm1(offset)) >= MIN_REPORTED_CHANGE else "unchanged"


def _expect(node_id: str, name: str, holds: bool, expected: str, value: object) -> None:
    if not holds:
        raise InputError(f"prior of {node_id}: {name}: expected {expected}; found {value}")


def has_distinct_components(prior: Prior) -> bool:
    """Return True if two components of a prior are cleanly parted: two kinds of object under one name."""
    if len(prior.weights) < 2:
        return False
    centre = prior.means.mean(axis=1)  # ln of the geometric mean size
    spread = np.sqrt(prior.covariances.mean(axis=(1, 2)))
    apart = np.abs(centre[:, None] - centre)
    d = np.sqrt(2) * apart / np.hypot(spread[:, None], spread)
    enough = np.minimum(prior.weights[:, None], prior.weights) >= MIN_COMPONENT_SHARE
    return bool(((d > MIN_ASHMAN_D) & enough & (apart > np.log(MIN_SIZE_RATIO))).any())
