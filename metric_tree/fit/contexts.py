"""What rows say of regions and years: the mean of each source, region and span of years, and how much that explains.

The model is that of `metric_tree.context`. Its five numbers are those under which the sources of a class predict best
what a source that is left out states about its regions and years, over all classes; a class's covariance between
sources is what `metric_tree.fit.evidence_model` says it is and is only parted. The likelihood of all sources together
is no judge: within one maker's list years differ by more than the sources of a class do, and it would make everything
region and year.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.context import Context, ContextModel, Likeness
from metric_tree.fit.random_effects import CERTAIN_ROWS
from metric_tree.prior import Prior

#: Years of one span: a car model lives for six, and fewer rows say less.
YEAR_SPAN = 5

#: Kinds of objects in use today where they were measured, sold or required.
KINDS = frozenset({"product", "measured", "standard", "statistic"})

#: Contexts of a class that take part in the model, those of most rows.
MAX_CELLS = 30

#: Least part of a node's weight of which a source must speak to be a context of the node.
LEAST_PART = 0.2

#: Decimals of a published offset: a thousandth of a per cent.
DECIMALS = 5

#: What is tried for each number of the model.
GRIDS: Mapping[str, tuple[float, ...]] = {
    "region": (0.0, 0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6),
    "year": (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6),
    "own": (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5),
    "kin": (0.1, 0.3, 0.5, 0.7, 0.9),
    "years": (5.0, 8.0, 12.0, 20.0, 30.0, 50.0),
}

#: Rounds over the grids; the third changes nothing.
ROUNDS = 2

#: Before any class is seen, and where no class has two contexts.
START = ContextModel(region=0.2, year=0.1, own=0.1, kin=0.5, years=12.0)


@dataclass(frozen=True, slots=True, eq=False)
class ContextCell:
    """Rows of one source, region and span of years: mean (d,) of ln size, NaN unstated, and effective rows (d,)."""

    source: str
    region: str | None
    year: float | None
    mean: FloatArray
    rows: FloatArray


def cells_of(
    x: FloatArray,
    source: NDArray[np.str_],
    kind: NDArray[np.str_],
    region: Sequence[str | None],
    year: Sequence[int | None],
    weight: FloatArray,
) -> tuple[ContextCell, ...]:
    """The cells of a class's rows that say a region or a year.

    Parameters
    ----------
    x : (n, d) ln size, NaN where unstated; source, kind, region, year : of the rows; weight : (n,) one over the rows
        of the class in the row's scene
    """
    rows: dict[tuple[str, str, int], list[int]] = {}
    for number in np.flatnonzero(np.isin(kind, sorted(KINDS))).tolist():
        place, when = region[number], year[number]
        if place not in (None, "world") or when is not None:
            span = -1 if when is None else when // YEAR_SPAN
            rows.setdefault((str(source[number]), place or "", span), []).append(number)
    return tuple(_cell(key, x, np.array(own), kind, year, weight) for key, own in sorted(rows.items()))


def _cell(
    key: tuple[str, str, int],
    x: FloatArray,
    own: NDArray[np.intp],
    kind: NDArray[np.str_],
    year: Sequence[int | None],
    weight: FloatArray,
) -> ContextCell:
    """The cell of the rows `own` (k,).

    x : (n, d) ln size, NaN where unstated; kind, year : (n,) of the rows; weight : (n,) one over the rows in the row's
    scene.
    """
    source, region, _ = key
    parts = np.where(np.isnan(x[own]), 0.0, weight[own, None])  # (n, d)
    mass = parts.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (parts * np.nan_to_num(x[own])).sum(axis=0) / mass
        rows = mass**2 / (parts**2).sum(axis=0)
    certain = np.where(kind[own[0]] == "statistic", CERTAIN_ROWS, 1.0)
    years = [when for number in own.tolist() if (when := year[number]) is not None]
    when = float(np.mean(years)) if years else None
    return ContextCell(source, region or None, when, np.where(mass > 0, mean, np.nan), np.nan_to_num(rows) * certain)


def class_contexts(prior: Prior, axes: Sequence[str], cells: Sequence[ContextCell], within: FloatArray) -> Prior:
    """The prior with the contexts of its class; `axes` are those of the cells, `within` (d,) variances in a source."""
    chosen = [list(axes).index(dim) for dim in prior.dims]
    centre = prior.weights @ prior.means
    contexts = []
    for cell in cells:
        rows = cell.rows[chosen]
        if (rows > 0).any():
            offset = np.where(rows > 0, cell.mean[chosen] - centre, np.nan)
            variance = within[chosen] / np.maximum(rows, 1e-9)
            contexts.append(Context(cell.source, cell.region, cell.year, *_round_context(offset, variance)))
    return replace(prior, contexts=tuple(contexts))


def inner_contexts(
    children: Sequence[Prior], share: FloatArray, shared: FloatArray, plain: Prior | None = None
) -> tuple[Context, ...]:
    """The contexts of a node: those of its children of the same source, region and years, by the children's weight.

    A source that covers the part q of the weight says the mean over that part, and off the node's own by a share
    (1 - q) / q of B. What a source calls by the node's plain name covers the whole node: a street's cars are of all
    kinds, in the parts that are driven there.

    Parameters
    ----------
    children : priors over the node's dimensions; share : (c,) their weights, sum 1; shared : (d,) variances of B;
    plain : the prior of the leaf of objects called by the plain name alone, over the node's dimensions
    """
    whole = plain.contexts if plain is not None else ()
    covered = {(one.source, one.region) for one in whole}
    parts = [
        (child, part)
        for child, part in zip(children, share.tolist(), strict=True)
        if plain is None or child.node_id != plain.node_id
    ]
    rest = [one for one in _contexts_by_source(parts, shared) if (one.source, one.region) not in covered]
    return (*whole, *rest)


def _contexts_by_source(children: Sequence[tuple[Prior, float]], shared: FloatArray) -> list[Context]:
    """The contexts of weighted children, one for each source, region and span; shared : (d,) variances of B."""
    groups: dict[tuple[str, str, int], list[tuple[float, Context]]] = {}
    for child, part in children:
        for one in child.contexts:
            key = (one.source, one.region or "", -1 if one.year is None else int(one.year // YEAR_SPAN))
            groups.setdefault(key, []).append((part, one))
    return [one for _, own in sorted(groups.items()) for one in _together(own, shared)]


def _together(own: Sequence[tuple[float, Context]], shared: FloatArray) -> list[Context]:
    """Contexts of several families as one, weighted by their parts; shared : (d,) variances of B."""
    parts = np.array([part for part, _ in own])
    offsets = np.array([one.offset for _, one in own])  # (c, d)
    weights = np.where(np.isnan(offsets), 0.0, parts[:, None])
    part = weights.sum(axis=0)
    if part.max() < LEAST_PART:
        return []
    stated = np.maximum(part, 1e-9)
    offset = (weights * np.nan_to_num(offsets)).sum(axis=0) / stated
    variances = np.nan_to_num(np.array([one.variance for _, one in own]))
    variance = (weights**2 * variances).sum(axis=0) / stated**2 + np.maximum(1 - part, 0) / stated * shared
    years = [(share, one.year) for share, one in own if one.year is not None]
    year = sum(share * when for share, when in years) / sum(share for share, _ in years) if years else None
    offset = np.where(part >= LEAST_PART, offset, np.nan)
    return [Context(own[0][1].source, own[0][1].region, year, *_round_context(offset, variance))]


def _round_context(offset: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Offset (d,) and variance (d,) as published; a sampling variance is never nothing.

    At nothing a source's word would be the whole truth.
    """
    known = np.where(np.isnan(offset), np.nan, np.maximum(np.round(variance, DECIMALS + 1), 10.0 ** -(DECIMALS + 1)))
    return np.round(offset, DECIMALS), known


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """One axis of one class: its contexts' likeness, mean (n,), noise (n,) in parts of B, B, the cells by source."""

    likeness: Likeness
    own: tuple[NDArray[np.intp], ...]
    means: FloatArray
    noise: FloatArray
    between: float


def learn_contexts(classes: Iterable[tuple[Sequence[ContextCell], FloatArray, FloatArray]]) -> ContextModel:
    """The model from the cells, the variances (d,) within a source, and those of B, of all classes."""
    lines = [line for cells, within, between in classes for line in _lines(cells, within, between)]
    model = START
    if not lines:
        return model
    for _ in range(ROUNDS):
        for name, grid in GRIDS.items():
            options = [model._replace(**{name: value}) for value in grid]
            allowed = [option for option in options if option.region + option.year + option.own < 0.95]
            model = max(allowed, key=lambda one: sum(_prediction(line, one) for line in lines))
    return model


def _lines(cells: Sequence[ContextCell], within: FloatArray, between: FloatArray) -> list[_Line]:
    """What each axis that two sources or more state can tell of the cells: variances within (d,) and between (d,)."""
    lines = []
    for axis in range(len(within)):
        stated = sorted((cell for cell in cells if cell.rows[axis] > 0), key=lambda cell: -cell.rows[axis])[:MAX_CELLS]
        if len({cell.source for cell in stated}) >= 2 and between[axis] > 0:
            noise = np.array([within[axis] / cell.rows[axis] for cell in stated]) / between[axis]
            lines.append(
                _Line(
                    Likeness.of(*zip(*((one.source, one.region, one.year) for one in stated), strict=True)),
                    _by_source([cell.source for cell in stated]),
                    np.array([cell.mean[axis] for cell in stated]),
                    np.maximum(noise, 1e-4),
                    float(between[axis]),
                )
            )
    return lines


def _by_source(sources: Sequence[str]) -> tuple[NDArray[np.intp], ...]:
    """The places (k,) of each source's cells."""
    names, code = np.unique(np.asarray(sources), return_inverse=True)
    return tuple(np.flatnonzero(code == number) for number in range(len(names)))


def _prediction(line: _Line, model: ContextModel) -> float:
    """How well the cells of each source are predicted by the others: mean log density of a cell, summed over sources.

    With Q = V^-1 - V^-1 1 1' V^-1 / (1' V^-1 1) the cells b of a source lie Q_bb^-1 (Q m)_b off what the others say of
    them, with covariance Q_bb^-1 (Dubrule 1983, for one cell; for several by the same blocks).
    """
    inverse = np.linalg.inv(line.likeness.covariance(model) + np.diag(line.noise))
    weight = inverse.sum(axis=1)
    precision = inverse - np.outer(weight, weight) / weight.sum()
    leaning = precision @ line.means
    total = 0.0
    for own in line.own:
        covariance = np.linalg.inv(precision[np.ix_(own, own)])
        variance = np.diagonal(covariance)
        total -= 0.5 * float(np.mean(np.log(variance) + (covariance @ leaning[own]) ** 2 / (variance * line.between)))
    return total
