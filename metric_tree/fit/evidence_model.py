"""Bias, spread and disagreement of the kinds of evidence, estimated over all classes by restricted maximum likelihood.

The target is the size of objects in scenes. With m_s the mean of ln size of source s of class c along one axis,

    m_s = mu_c + b(kind of s, family of c) + e_s
    Var(e_s) = g(family) (share W + spread^2) + excess(kind)^2 + W / n_s

W is the variance of the class within a source and n_s the effective rows of the source. A family is a node of level 2.
Measurements, norms and statistics of measurements define the target and have no bias. The class means mu_c are
integrated out under a flat prior (restricted likelihood, Patterson and Thompson 1971). b has a Gaussian prior with mean
0 for each kind, and for each family about the value of its kind. share, spread and the excesses maximise the restricted
likelihood of a mixture in which some classes are two objects with one name. ln g has a Gaussian prior with mean 0.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray, IntArray
from metric_base.folders import data_folder
from metric_tree.fit.random_effects import SourceMeans

#: Prior standard deviation of the bias of a kind, ln size. Other kinds define the target and have no bias. Catalogue
#: sizes are of real objects, and differ from the objects in use by a few per cent because of what people buy and keep;
#: the others may differ by a third.
BIAS_SD: Mapping[str, float] = {"product": 0.05, "asset": 0.3, "museum": 0.3, "judged": 0.2, "default": 0.3}

#: Prior standard deviation of the bias of a family about the bias of its kind: half of `BIAS_SD`.
FAMILY_SD: Mapping[str, float] = {kind: sd / 2 for kind, sd in BIAS_SD.items()}

#: Kinds whose sources may disagree more than products and measurements.
EXCESS_KINDS = ("statistic", "judged", "asset", "museum", "default")

#: Kinds whose objects differ from objects that are sold, used and measured today.
WEAK_KINDS = frozenset({"asset", "museum", "default"})

#: Fraction of classes that are two objects with one name, 0 to 1.
MIXED_SHARE = 0.05

#: Standard deviation of ln size between the sources of such a class.
MIXED_SD = 1.0

#: Minimum number of classes with two sources for a refit; with fewer, the shipped model is used unchanged.
MIN_CLASSES = 8

#: Number of classes at which the model of a build has the same weight as the shipped model, which is of 700 classes.
#: Forty classes determine a bias of 10 % to about 3 %.
SHIPPED_CLASSES = 40.0

#: Number of iterations over biases and variances; the likelihood gains less than 0.1 % after the third.
ROUNDS = 4

#: Correlation between axes of the errors that are not proportional to W: errors of size rather than of proportion.
CORRELATION = 0.5

#: Prior standard deviation of ln g: families differ by less than a factor of 2.
FAMILY_FACTOR_SD = 0.5

#: Minimum standard deviation of ln size in the geometric mean of two models; a smaller one is practically zero.
MIN_LOG_SD = 0.005

#: Maximum number of sources of a class in the fit, the sources with the most rows; more do not change the result.
MAX_SOURCES = 10

#: Number of additional classes with a ratio of 1 in the estimate of the spread ratios.
RATIO_PRIOR_CLASSES = 10


@dataclass(frozen=True, slots=True)
class EvidenceModel:
    """The fitted model; the defaults are the rounded estimates from the sources of release 2.0.0."""

    #: Disagreement of products and measurements as a fraction of W.
    share: float = 0.3
    #: Disagreement that is not proportional to W, ln size.
    spread: float = 0.05
    #: Further standard deviation of ln size by kind.
    excess: Mapping[str, float] = field(
        default_factory=lambda: {"statistic": 0.03, "judged": 0.1, "asset": 0.15, "museum": 0.35, "default": 0.1}
    )
    #: Bias of ln size by kind, over all families.
    bias: Mapping[str, float] = field(default_factory=dict)
    #: Further bias by "kind family".
    family_bias: Mapping[str, float] = field(default_factory=dict)
    #: ln of the spread within a source of a kind over the spread within products and measurements.
    ratio: Mapping[str, float] = field(default_factory=dict)
    #: g by family.
    family: Mapping[str, float] = field(default_factory=dict)

    def towards(self, other: EvidenceModel, part: float) -> EvidenceModel:
        """Interpolate between another model (part 0) and this one (part 1): scales geometrically, biases linearly."""

        def geometric(a: float, b: float) -> float:
            return float(max(a, MIN_LOG_SD) ** part * max(b, MIN_LOG_SD) ** (1 - part))

        def linear(a: float, b: float) -> float:
            return part * a + (1 - part) * b

        def by_key(
            a: Mapping[str, float], b: Mapping[str, float], mean: Callable[[float, float], float], unknown: float
        ) -> dict[str, float]:
            return {key: mean(a.get(key, b.get(key, unknown)), b.get(key, unknown)) for key in sorted({*a, *b})}

        return EvidenceModel(
            share=geometric(self.share, other.share),
            spread=geometric(self.spread, other.spread),
            excess=by_key(self.excess, other.excess, geometric, 0.0),
            bias=by_key(self.bias, other.bias, linear, 0.0),
            family_bias=by_key(self.family_bias, other.family_bias, linear, 0.0),
            ratio=by_key(self.ratio, other.ratio, linear, 0.0),
            family=by_key(self.family, other.family, geometric, 1.0),
        )

    def bias_of(self, kind: str, family: str) -> float:
        """Return the bias of a kind in a family, ln size."""
        return self.bias.get(kind, 0.0) + self.family_bias.get(f"{kind} {family}", 0.0)

    def error_sd(self, kind: str) -> float:
        """Return the standard deviation of the error of a source of a kind, in addition to B.

        The models of an artist or the pieces of a museum may have another sense of the word: with `MIXED_SHARE`.
        """
        wrong_sense = MIXED_SHARE * MIXED_SD**2 if kind in WEAK_KINDS else 0.0
        return float(np.sqrt(self.excess.get(kind, 0.0) ** 2 + wrong_sense))

    def between(self, within: FloatArray, family: str = "") -> FloatArray:
        """Return the error covariance (d, d) of a product or measurement in a class with the covariance `within`."""
        common = CORRELATION + (1 - CORRELATION) * np.eye(len(within))
        return np.asarray(self.family.get(family, 1.0) * (self.share * within + self.spread**2 * common))

    def record(self) -> dict[str, Any]:
        """Return the model as in the manifest of a release."""
        return {
            name: {key: round(number, 4) for key, number in sorted(value.items())}
            if isinstance(value, Mapping)
            else round(value, 4)
            for name, value in asdict(self).items()
        }


@dataclass(frozen=True, slots=True, eq=False)
class SourceTable:
    """Source means of n class axes, with s = `MAX_SOURCES` columns."""

    means: FloatArray  #: (n, s) of ln mm, 0 if there is no source.
    noise: FloatArray  #: (n, s) sampling variance W / n_s.
    present: FloatArray  #: (n, s) 1 if there is a source, else 0.
    within: FloatArray  #: (n,) W.
    kind: IntArray  #: (n, s) index into `kinds`.
    family: IntArray  #: (n,) index into `families`.
    kinds: Sequence[str]
    families: Sequence[str]

    @classmethod
    def of(cls, classes: Sequence[tuple[str, SourceMeans]], kinds: Sequence[str]) -> SourceTable:
        """Return the table of the axes that two sources or more of a class state, from (family, source means)."""
        families = sorted({family for family, _ in classes})
        lines = []
        for family, by_source in classes:
            for axis in range(by_source.means.shape[1]):
                rows = by_source.rows[:, axis]
                chosen = np.flatnonzero(rows > 0)
                chosen = chosen[np.argsort(-rows[chosen], kind="stable")][:MAX_SOURCES]
                if len(chosen) >= 2:
                    lines.append((family, by_source, axis, chosen))
        shape = (len(lines), MAX_SOURCES)
        means, noise, present = np.zeros(shape), np.ones(shape), np.zeros(shape)
        kind = np.zeros(shape, dtype=np.intp)
        within = np.array([by_source.within[axis, axis] for _, by_source, axis, _ in lines])
        for line, (_, by_source, axis, chosen) in enumerate(lines):
            part = slice(0, len(chosen))
            means[line, part] = by_source.means[chosen, axis]
            noise[line, part] = by_source.within[axis, axis] / by_source.rows[chosen, axis]
            present[line, part] = 1.0
            kind[line, part] = [kinds.index(by_source.kinds[source]) for source in chosen]
        family_index = np.array([families.index(line[0]) for line in lines])
        return cls(means, noise, present, within, kind, family_index, kinds, families)

    def variances(self, model: EvidenceModel) -> FloatArray:
        """Return Var(e_s) of each source under a model, (n, s)."""
        excess = np.array([model.excess.get(kind, 0.0) for kind in self.kinds])[self.kind]
        factor = np.array([model.family.get(family, 1.0) for family in self.families])[self.family]
        base = factor * (model.share * self.within + model.spread**2)
        return np.asarray(base[:, None] + excess**2 + self.noise)

    def biases(self, model: EvidenceModel) -> FloatArray:
        """Return the bias of each source under a model, (n, s)."""
        biases = np.array([[model.bias_of(kind, family) for family in self.families] for kind in self.kinds])
        return np.asarray(biases[self.kind, self.family[:, None]])


def fit_evidence_model(classes: Iterable[tuple[str, SourceMeans]], kinds: Sequence[str]) -> EvidenceModel:
    """Fit the model to (family, source means) of all classes and shrink it towards the shipped model.

    The weight of the shipped model is that of `SHIPPED_CLASSES` classes.
    """
    shipped = shipped_model()
    several = [(family, by_source) for family, by_source in classes if len(by_source.sources) >= 2]
    if len(several) < MIN_CLASSES:
        return shipped
    table = SourceTable.of(several, kinds)
    model = EvidenceModel(bias={}, ratio=spread_ratios([by_source for _, by_source in several]))
    for _ in range(ROUNDS):
        model = with_biases(model, table)
        model = with_variances(model, table)
        model = with_family_factors(model, table)
    return model.towards(shipped, len(several) / (len(several) + SHIPPED_CLASSES))


@cache
def shipped_model() -> EvidenceModel:
    """Return the model of the shipped release (`data/fitted/evidence_model.json`)."""
    return EvidenceModel(**json.loads((data_folder() / "fitted" / "evidence_model.json").read_text(encoding="utf-8")))


def restricted_likelihood(means: FloatArray, variances: FloatArray, present: FloatArray) -> FloatArray:
    """Return the restricted log likelihood (n,) of source means (n, s), with the class mean integrated out.

    -(sum ln V + ln sum 1/V + sum (m - mu)^2 / V) / 2 over the sources that are `present`, up to a constant
    """
    weight = present / variances
    total = weight.sum(axis=1)
    mu = (weight * means).sum(axis=1) / total
    square = (weight * (means - mu[:, None]) ** 2).sum(axis=1)
    return np.asarray(-0.5 * ((present * np.log(variances)).sum(axis=1) + np.log(total) + square))


def sense_likelihoods(means: FloatArray, variances: FloatArray, present: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return log prior plus log likelihood (n,) for one object, and for two objects with one name.

    means : (n, s) of ln mm, minus the biases; variances : (n, s); present : (n, s), 1 if there is a source, else 0.
    """
    one = np.log(1 - MIXED_SHARE) + restricted_likelihood(means, variances, present)
    two = np.log(MIXED_SHARE) + restricted_likelihood(means, variances + MIXED_SD**2, present)
    return one, two


def with_biases(model: EvidenceModel, table: SourceTable) -> EvidenceModel:
    """Estimate the biases given the variances, by ridge regression with the class means projected out.

    With P = V^-1 - V^-1 1 1' V^-1 / (1' V^-1 1) of each line, b = (sum X' P X + prior^-1)^-1 sum X' P m.
    """
    variances = table.variances(model)
    one, two = sense_likelihoods(table.means - table.biases(model), variances, table.present)
    trust = 1 / (1 + np.exp(np.minimum(two - one, 50.0)))  # (n,) probability of one object
    weight = table.present / variances
    total = weight.sum(axis=1)
    biased = [kind for kind in table.kinds if kind in BIAS_SD]
    columns: list[tuple[str, int | None]] = [(kind, None) for kind in biased]
    columns += [(kind, family) for kind in biased for family in range(len(table.families))]
    design = np.stack(
        [
            (table.kind == table.kinds.index(kind)) * (1.0 if family is None else (table.family == family)[:, None])
            for kind, family in columns
        ]
    )  # (c, n, s)
    projected = weight * design - weight * ((weight * design).sum(axis=2) / total)[:, :, None]
    scaled = projected * trust[:, None]
    normal = np.einsum("cns,dns->cd", scaled, design)
    right = np.einsum("cns,ns->c", scaled, table.means)
    prior_sd = [BIAS_SD[kind] if family is None else FAMILY_SD[kind] for kind, family in columns]
    solution = np.linalg.solve(normal + np.diag(1 / np.square(prior_sd)), right)
    values = dict(zip(columns, solution.tolist(), strict=True))
    return replace(
        model,
        bias={kind: values[kind, None] for kind in biased},
        family_bias={
            f"{kind} {table.families[family]}": values[kind, family] for kind, family in columns if family is not None
        },
    )


def with_variances(model: EvidenceModel, table: SourceTable) -> EvidenceModel:
    """Estimate share, spread and excesses in turn by grid search, given the biases."""
    means = table.means - table.biases(model)

    def likelihood(candidate: EvidenceModel) -> float:
        one, two = sense_likelihoods(means, table.variances(candidate), table.present)
        return float(np.logaddexp(one, two).sum())

    model = max((replace(model, share=float(share)) for share in np.geomspace(0.02, 1.5, 14)), key=likelihood)
    model = max((replace(model, spread=float(spread)) for spread in np.geomspace(0.01, 0.3, 14)), key=likelihood)
    for kind in EXCESS_KINDS:
        if (table.kind[table.present > 0] == table.kinds.index(kind)).any():
            grid = (0.0, *np.geomspace(0.02, 1.0, 14))
            model = max((replace(model, excess={**model.excess, kind: float(sd)}) for sd in grid), key=likelihood)
    return model


def with_family_factors(model: EvidenceModel, table: SourceTable) -> EvidenceModel:
    """Estimate the factor g of each family by grid search, given the other parameters."""
    means = table.means - table.biases(model)
    grid = np.geomspace(0.15, 5.0, 15)
    log_posteriors = []
    for factor in grid:
        candidate = replace(model, family=dict.fromkeys(table.families, float(factor)))
        one, two = sense_likelihoods(means, table.variances(candidate), table.present)
        by_family = np.bincount(table.family, np.logaddexp(one, two), len(table.families))
        log_posteriors.append(by_family - 0.5 * (np.log(factor) / FAMILY_FACTOR_SD) ** 2)
    best = grid[np.argmax(log_posteriors, axis=0)]
    return replace(model, family=dict(zip(table.families, best.tolist(), strict=True)))


def spread_ratios(classes: Sequence[SourceMeans]) -> dict[str, float]:
    """Return the mean ln ratio of the spread of a kind to the spread of products and measurements of the same class.

    The mean includes `RATIO_PRIOR_CLASSES` classes with a ratio of 1.
    """
    ratios: dict[str, list[float]] = {"asset": [], "museum": []}
    for by_source in classes:
        known = [pair for pair in zip(by_source.kinds, by_source.spreads, strict=True) if np.isfinite(pair[1])]
        spreads = {kind: [sd for name, sd in known if name == kind] for kind in ("product", "measured", *ratios)}
        reference = spreads["product"] + spreads["measured"]
        for kind, values in ratios.items():
            if reference and spreads[kind]:
                values.append(float(np.mean(np.log(spreads[kind])) - np.mean(np.log(reference))))
    return {kind: sum(values) / (len(values) + RATIO_PRIOR_CLASSES) for kind, values in ratios.items()}
