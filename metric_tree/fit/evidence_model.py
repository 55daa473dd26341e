"""What each kind of evidence is worth: its bias, its spread, how far its sources lie apart; learned over all classes.

What an object in a scene is like is the target. With m_s the mean of ln size of source s of class c along one axis,

    m_s = mu_c + b(kind of s, family of c) + e_s
    Var(e_s) = g(family) (share W + spread^2) + excess(kind)^2 + W / n_s

W is the class's variance within a source and n_s the effective rows of the source. A family is a node of level 2.
Measurements, norms and statistics of measurements have no bias: they are the target. The class means mu_c are
integrated out under a flat prior; b has a Gaussian prior around zero, family by family around its kind's own; share,
spread and the excesses maximise the restricted likelihood, in which a few classes are two objects under one name; ln g
has a Gaussian prior around zero.
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

#: Prior standard deviation of a kind's bias (ln size). Kinds that are not here are of objects in the world: they define
#: the target and have no bias. A shop's figure is of a real object and may differ from the
#: objects in use by what people buy and keep, a few per cent; the others may be anything within a third.
BIAS_SD: Mapping[str, float] = {"product": 0.05, "asset": 0.3, "museum": 0.3, "judged": 0.2, "default": 0.3}

#: Prior standard deviation of a family's bias around its kind's: half of what the kinds themselves are allowed.
FAMILY_SD: Mapping[str, float] = {kind: sd / 2 for kind, sd in BIAS_SD.items()}

#: Kinds whose sources may lie further apart than those of products and measurements.
EXCESS_KINDS = ("statistic", "judged", "asset", "museum", "default")

#: Kinds whose objects are not what is sold, used and measured today.
WEAK_KINDS = frozenset({"asset", "museum", "default"})

#: Share of classes that are two objects under one name, and the disagreement (ln size) that they are allowed.
MIXED_SHARE, MIXED_SD = 0.05, 1.0

#: Below this many classes with two sources the shipped model holds as it is.
LEAST_CLASSES = 8

#: Classes at which a build's own model counts as much as the shipped one: that of release 2.0.0 was of 700, and with
#: forty classes a bias of ten per cent is known to some three.
SHIPPED_CLASSES = 40.0

#: Rounds of alternating between biases and variances; the likelihood gains under 0.1 % after the third.
ROUNDS = 4

#: Correlation between axes of the part of an error that does not follow the class's spread: size more than proportion.
CORRELATION = 0.5

#: Prior standard deviation of ln g: families differ by less than twofold.
FAMILY_FACTOR_SD = 0.5

#: Least standard deviation that is mixed in proportion: under it a source is as good as exact.
LEAST_SD = 0.005

#: Sources of a class that take part, those of most rows; more add nothing that decides.
MAX_SOURCES = 10


@dataclass(frozen=True, slots=True)
class KindModel:
    """The fitted model; the defaults are what the sources of release 2.0.0 gave, rounded.

    share, spread : disagreement of products and measurements, share W + spread^2; excess : further standard deviation
    by kind; bias : by kind, of all families; family_bias : by "kind family", added to the former; ratio : ln of the
    spread within a source of a kind over that of products and measurements; family : g by family.
    """

    share: float = 0.3
    spread: float = 0.05
    excess: Mapping[str, float] = field(
        default_factory=lambda: {"statistic": 0.03, "judged": 0.1, "asset": 0.15, "museum": 0.35, "default": 0.1}
    )
    bias: Mapping[str, float] = field(default_factory=dict)
    family_bias: Mapping[str, float] = field(default_factory=dict)
    ratio: Mapping[str, float] = field(default_factory=dict)
    family: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> KindModel:
        """The model of `record`."""
        return cls(**record)

    def towards(self, other: KindModel, part: float) -> KindModel:
        """Between another model (part 0) and this one (part 1): scales in proportion, biases by the mean."""

        def scale(own: float, its: float) -> float:
            return float(max(own, LEAST_SD) ** part * max(its, LEAST_SD) ** (1 - part))

        def plain(own: float, its: float) -> float:
            return part * own + (1 - part) * its

        def both(
            own: Mapping[str, float], its: Mapping[str, float], mix: Callable[[float, float], float], unknown: float
        ) -> dict[str, float]:
            return {
                key: mix(own.get(key, its.get(key, unknown)), its.get(key, unknown)) for key in sorted({*own, *its})
            }

        return KindModel(
            share=scale(self.share, other.share),
            spread=scale(self.spread, other.spread),
            excess=both(self.excess, other.excess, scale, 0.0),
            bias=both(self.bias, other.bias, plain, 0.0),
            family_bias=both(self.family_bias, other.family_bias, plain, 0.0),
            ratio=both(self.ratio, other.ratio, plain, 0.0),
            family=both(self.family, other.family, scale, 1.0),
        )

    def bias_of(self, kind: str, family: str) -> float:
        """Bias of a kind in a family, ln size."""
        return self.bias.get(kind, 0.0) + self.family_bias.get(f"{kind} {family}", 0.0)

    def error_sd(self, kind: str) -> float:
        """Standard deviation of what a source of a kind is off by, beside B.

        An artist's model or a museum's piece may be of another sense of the word: as often as classes are mixed.
        """
        wrong_sense = MIXED_SHARE * MIXED_SD**2 if kind in WEAK_KINDS else 0.0
        return float(np.sqrt(self.excess.get(kind, 0.0) ** 2 + wrong_sense))

    def between(self, within: FloatArray, family: str = "") -> FloatArray:
        """Covariance (d, d) of the error of a product or a measurement, of a class with covariance `within` (d, d)."""
        common = CORRELATION + (1 - CORRELATION) * np.eye(len(within))
        return np.asarray(self.family.get(family, 1.0) * (self.share * within + self.spread**2 * common))

    def record(self) -> dict[str, Any]:
        """The model as the manifest has it."""
        return {
            name: {key: round(number, 4) for key, number in sorted(value.items())}
            if isinstance(value, Mapping)
            else round(value, 4)
            for name, value in asdict(self).items()
        }


@dataclass(frozen=True, slots=True, eq=False)
class _KindTable:
    """One line for each class and axis: means (n, s) NaN-free, noise (n, s), present (n, s), w (n,), kind, family."""

    means: FloatArray
    noise: FloatArray
    present: FloatArray
    within: FloatArray
    kind: IntArray
    family: IntArray


def learn_kinds(classes: Iterable[tuple[str, SourceMeans]], kinds: Sequence[str]) -> KindModel:
    """The model from (family, disagreement) of all classes, drawn to the shipped one as far as they are few."""
    shipped = shipped_model()
    pairs = [(family, one) for family, one in classes if len(one.sources) >= 2]
    ratio = _spread_ratios([one for _, one in pairs])
    if len(pairs) < LEAST_CLASSES:
        return shipped
    families = sorted({family for family, _ in pairs})
    table = _table(pairs, families, kinds)
    model = KindModel(bias={}, ratio=ratio)
    for _ in range(ROUNDS):
        model = _with_biases(model, table, kinds, families)
        model = _with_variances(model, table, kinds, families)
        model = _with_families(model, table, kinds, families)
    return model.towards(shipped, len(pairs) / (len(pairs) + SHIPPED_CLASSES))


@cache
def shipped_model() -> KindModel:
    """What the sources of the shipped release gave (`data/fitted/evidence_model.json`)."""
    path = data_folder() / "fitted" / "evidence_model.json"
    return KindModel.of_record(json.loads(path.read_text(encoding="utf-8")))


def _table(pairs: Sequence[tuple[str, SourceMeans]], families: Sequence[str], kinds: Sequence[str]) -> _KindTable:
    lines = []
    for family, one in pairs:
        for axis in range(one.means.shape[1]):
            rows = one.rows[:, axis]
            chosen = np.flatnonzero(rows > 0)
            chosen = chosen[np.argsort(-rows[chosen], kind="stable")][:MAX_SOURCES]
            if len(chosen) >= 2:
                lines.append((family, one, axis, chosen))
    shape = (len(lines), MAX_SOURCES)
    means, noise, present = np.zeros(shape), np.ones(shape), np.zeros(shape)
    kind = np.zeros(shape, dtype=np.intp)
    within = np.array([one.within[axis, axis] for _, one, axis, _ in lines])
    for line, (_, one, axis, chosen) in enumerate(lines):
        part = slice(0, len(chosen))
        means[line, part] = one.means[chosen, axis]
        noise[line, part] = one.within[axis, axis] / one.rows[chosen, axis]
        present[line, part] = 1.0
        kind[line, part] = [kinds.index(one.kinds[source]) for source in chosen]
    return _KindTable(means, noise, present, within, kind, np.array([families.index(line[0]) for line in lines]))


def _variances(model: KindModel, table: _KindTable, kinds: Sequence[str], families: Sequence[str]) -> FloatArray:
    """Var(e_s) of every source, (n, s)."""
    excess = np.array([model.excess.get(kind, 0.0) for kind in kinds])[table.kind]
    factor = np.array([model.family.get(family, 1.0) for family in families])[table.family]
    base = factor * (model.share * table.within + model.spread**2)
    return np.asarray(base[:, None] + excess**2 + table.noise)


def _offsets(model: KindModel, table: _KindTable, kinds: Sequence[str], families: Sequence[str]) -> FloatArray:
    """Bias of every source, (n, s)."""
    biases = np.array([[model.bias_of(kind, family) for family in families] for kind in kinds])
    return np.asarray(biases[table.kind, table.family[:, None]])


def _restricted_likelihood(means: FloatArray, variances: FloatArray, present: FloatArray) -> FloatArray:
    """Restricted log likelihood of each line, (n,): -(sum ln V + ln sum 1/V + sum (m - mu)^2 / V) / 2."""
    weight = present / variances
    total = weight.sum(axis=1)
    mu = (weight * means).sum(axis=1) / total
    square = (weight * (means - mu[:, None]) ** 2).sum(axis=1)
    return np.asarray(-0.5 * ((present * np.log(variances)).sum(axis=1) + np.log(total) + square))


def _plain_and_mixed(means: FloatArray, variances: FloatArray, present: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) log of share times likelihood of each line, as one object under its name and as two.

    means : (n, s) ln mm of the sources, less their biases; variances : (n, s); present : (n, s), 1 where there is a
    source, else 0.
    """
    plain = np.log(1 - MIXED_SHARE) + _restricted_likelihood(means, variances, present)
    mixed = np.log(MIXED_SHARE) + _restricted_likelihood(means, variances + MIXED_SD**2, present)
    return plain, mixed


def _with_biases(model: KindModel, table: _KindTable, kinds: Sequence[str], families: Sequence[str]) -> KindModel:
    """Biases given the variances: ridge regression with the class means projected out.

    With P = V^-1 - V^-1 1 1' V^-1 / (1' V^-1 1) of each line: b = (sum X' P X + prior^-1)^-1 sum X' P m.
    """
    variances = _variances(model, table, kinds, families)
    plain, mixed = _plain_and_mixed(table.means - _offsets(model, table, kinds, families), variances, table.present)
    trust = 1 / (1 + np.exp(np.minimum(mixed - plain, 50.0)))  # (n,)
    weight = table.present / variances
    total = weight.sum(axis=1)
    biased = [kind for kind in kinds if kind in BIAS_SD]
    columns: list[tuple[str, int | None]] = [(kind, None) for kind in biased]
    columns += [(kind, number) for kind in biased for number in range(len(families))]
    design = np.stack(
        [
            (table.kind == kinds.index(kind)) * (1.0 if family is None else (table.family == family)[:, None])
            for kind, family in columns
        ]
    )  # (c, n, s)
    projected = weight * design - weight * ((weight * design).sum(axis=2) / total)[:, :, None]
    scaled = projected * trust[:, None]
    normal = np.einsum("cns,dns->cd", scaled, design)
    right = np.einsum("cns,ns->c", scaled, table.means)
    prior = [BIAS_SD[kind] if family is None else FAMILY_SD[kind] for kind, family in columns]
    solved = np.linalg.solve(normal + np.diag(1 / np.square(prior)), right)
    values = dict(zip(columns, solved.tolist(), strict=True))
    return replace(
        model,
        bias={kind: values[kind, None] for kind in biased},
        family_bias={
            f"{kind} {families[number]}": values[kind, number] for kind, number in columns if number is not None
        },
    )


def _with_variances(model: KindModel, table: _KindTable, kinds: Sequence[str], families: Sequence[str]) -> KindModel:
    """Share, spread and excesses one after the other on grids, given the biases."""
    means = table.means - _offsets(model, table, kinds, families)

    def height(one: KindModel) -> float:
        plain, mixed = _plain_and_mixed(means, _variances(one, table, kinds, families), table.present)
        return float(np.logaddexp(plain, mixed).sum())

    model = max((replace(model, share=float(share)) for share in np.geomspace(0.02, 1.5, 14)), key=height)
    model = max((replace(model, spread=float(spread)) for spread in np.geomspace(0.01, 0.3, 14)), key=height)
    for kind in EXCESS_KINDS:
        if (table.kind[table.present > 0] == kinds.index(kind)).any():
            grid = (0.0, *np.geomspace(0.02, 1.0, 14))
            options = (replace(model, excess={**model.excess, kind: float(sd)}) for sd in grid)
            model = max(options, key=height)
    return model


def _with_families(model: KindModel, table: _KindTable, kinds: Sequence[str], families: Sequence[str]) -> KindModel:
    """The factor g of each family on a grid, given the rest."""
    means = table.means - _offsets(model, table, kinds, families)
    grid = np.geomspace(0.15, 5.0, 15)
    heights = []
    for factor in grid:
        one = replace(model, family=dict.fromkeys(families, float(factor)))
        plain, mixed = _plain_and_mixed(means, _variances(one, table, kinds, families), table.present)
        own = np.bincount(table.family, np.logaddexp(plain, mixed), len(families))
        heights.append(own - 0.5 * (np.log(factor) / FAMILY_FACTOR_SD) ** 2)
    best = grid[np.argmax(heights, axis=0)]
    return replace(model, family=dict(zip(families, best.tolist(), strict=True)))


def _spread_ratios(classes: Sequence[SourceMeans]) -> dict[str, float]:
    """Mean ln ratio of a kind's spread within a source to that of products and measurements of the same class.

    Ten classes' worth of no difference are added.
    """
    ratios: dict[str, list[float]] = {"asset": [], "museum": []}
    for one in classes:
        known = {
            kind: [sd for sd, own in zip(one.spreads, one.kinds, strict=True) if own == kind and np.isfinite(sd)]
            for kind in ("product", "measured", *ratios)
        }
        reference = known["product"] + known["measured"]
        for kind, values in ratios.items():
            if reference and known[kind]:
                values.append(float(np.mean(np.log(known[kind])) - np.mean(np.log(reference))))
    return {kind: sum(values) / (len(values) + 10) for kind, values in ratios.items()}
