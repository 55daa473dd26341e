"""Which categories are fit for instance segmentation and scale estimation (paper 3, the three rules).

The paper chooses 43 by three rules: sizes diverge little, samples are enough, and other well-known data sets hold
training images. Each rule has its figure here. The better figure is what they are for: how far one object of the
category narrows the log of the scale. With u = log scale, flat over R before, and y = x - u 1 + noise the log of an
object's measured extents,

    narrowing = ln R - E[ H(u | y) ],    p(u | y) ~ sum_k w_k N(y + u 1; m_k, S_k + B + N)

in nats, where S_k is the spread within a source, B the disagreement of sources (it does not average out over the
objects of a scene) and N the measurement's noise. E is over objects of the prior itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.folders import taxonomy_directory
from metric_base.parsing import table_rows
from metric_tree.node import Node, NoPrior
from metric_tree.prior import Prior
from metric_tree.tree import Tree
from taxonomy.label_lists import vocabulary
from taxonomy.levels import BadLevels

#: Lists of data sets with instance masks that anyone can train on: the paper's three, and LVIS.
TRAINING_LISTS = ("coco_80", "ade20k_150", "openimages_601", "lvis_v1")

#: One standard deviation of a measured extent, natural log: what whole objects of synthetic rooms are off by.
MEASUREMENT_SD = 0.06

#: The range of scales held possible before: three decades, from a millimetre to a metre a unit or the like. It shifts
#: every category's narrowing alike and so changes no rank.
SCALE_RANGE = 1000.0

#: Objects of the expectation: its standard error is under 0.03 nats for every prior of the release.
MAX_DRAWS = 200

#: Grid over u about the truth: no posterior of a single object of a useful category reaches further.
GRID: FloatArray = np.arange(-4.0, 4.0, 0.02)


@dataclass(frozen=True, slots=True)
class Rules:
    """The thresholds of the three rules.

    count : how many to choose, as many as the paper. most_divergence : beyond it two ordinary objects differ twofold,
    and a narrow posterior rests on which of the fit's modes an object is of. least_samples : with which a spread is
    known to a sixth (one sigma). least_sources : of one source nobody knows how well it transfers. least_lists : of
    `TRAINING_LISTS`, for a name of one list only is that list's speciality.
    """

    count: int = 43
    most_divergence: float = 0.5
    least_samples: int = 20
    least_sources: int = 2
    least_lists: int = 2


@dataclass(frozen=True, slots=True, eq=False)
class CategoryCandidate:
    """A category with the figures of the rules.

    divergence : root mean square over dimensions of the standard deviation of log size; lists : the training sets that
    have it; narrowing : nats; sd : of the Gaussian over log scale with the expected entropy after one object.
    """

    node: Node
    prior: Prior
    divergence: float
    lists: tuple[str, ...]
    narrowing: float
    sd: float

    @property
    def samples(self) -> int:
        """Items of the fit."""
        return self.prior.n


def candidates(tree: Tree) -> list[CategoryCandidate]:
    """Every node that a training set names, those below which it names counted too, the most narrowing first."""
    named = _lists_of_nodes(tree)
    own = {label.node_id for name in TRAINING_LISTS for label in vocabulary(name) if label.node_id}
    own |= {node_id for _, node_id in paper_selection()}
    tried = [_candidate(node, named.get(node.node_id, ())) for node in tree if node.node_id in own]
    return sorted((one for one in tried if one is not None), key=lambda one: (-one.narrowing, one.node.node_id))


def choose(ranked: Sequence[CategoryCandidate], rules: Rules | None = None) -> list[CategoryCandidate]:
    """The `rules.count` most narrowing of the candidates that fit the three rules, none above or below another.

    A detector cannot be taught both a chair and an office chair as exclusive classes from sets that label only the one.
    Of two such the one that more training sets name is taken: that is where they draw the line.
    """
    rules = rules or Rules()
    fit = [one for one in ranked if _misfit(one, rules) is None]
    taken: list[CategoryCandidate] = []
    for one in sorted(fit, key=lambda one: (-len(one.lists), -one.narrowing, one.node.node_id)):
        if _relative(one, taken) is None:
            taken.append(one)
    return sorted(taken, key=lambda one: (-one.narrowing, one.node.node_id))[: rules.count]


def reason_against(
    one: CategoryCandidate, taken: Sequence[CategoryCandidate], rules: Rules | None = None
) -> str | None:
    """Why a candidate is not among those taken, or None if it is."""
    if any(one.node.node_id == other.node.node_id for other in taken):
        return None
    misfit = _misfit(one, rules or Rules())
    if misfit is not None:
        return misfit
    related = _relative(one, taken)
    if related is not None:
        return f"above or below {related.node.name}, which is chosen"
    least = min((other.narrowing for other in taken), default=math.inf)
    return f"narrows by {one.narrowing:.2f} nats, under {least:.2f}"


def divergence(prior: Prior) -> float:
    """Root mean square over dimensions of the standard deviation of log size, the mixture's own (total variance)."""
    return float(np.sqrt((prior.log_sd() ** 2).mean()))


def narrowing(prior: Prior, noise: float = MEASUREMENT_SD, seed: int = 0) -> float:
    """Expected reduction of the entropy of log scale by one object, in nats; see the module's equation."""
    d = len(prior.dims)
    covariance = prior.covariances + prior.disagreement() + noise**2 * np.eye(d)  # (k, d, d)
    generator = np.random.default_rng(seed)
    component = generator.choice(len(prior.weights), size=MAX_DRAWS, p=prior.weights / prior.weights.sum())
    lower = np.linalg.cholesky(covariance)
    y = prior.means[component] + np.einsum("nij,nj->ni", lower[component], generator.standard_normal((MAX_DRAWS, d)))
    precision = np.linalg.inv(covariance)
    residual = prior.means[None] - y[:, None]  # (n, k, d)
    turned = np.einsum("kij,nkj->nki", precision, residual)
    lam = precision.sum(axis=(1, 2))  # (k,)
    centre = turned.sum(axis=2) / lam  # (n, k)
    log_det = np.linalg.slogdet(covariance)[1]
    square = (residual * turned).sum(axis=2) - lam * centre**2
    peak = np.log(np.maximum(prior.weights, 1e-300)) - 0.5 * (log_det + square)  # (n, k)
    peak = np.exp(peak - peak.max(axis=1, keepdims=True))
    density = np.zeros((MAX_DRAWS, len(GRID)))
    for k in range(len(prior.weights)):  # components one by one: all at once would take 100 MB
        density += peak[:, k, None] * np.exp(-0.5 * lam[k] * (GRID - centre[:, k, None]) ** 2)
    step = GRID[1] - GRID[0]
    density /= density.sum(axis=1, keepdims=True) * step
    entropy = -(density * np.log(np.maximum(density, 1e-300))).sum(axis=1) * step
    return math.log(math.log(SCALE_RANGE)) - float(entropy.mean())


def paper_selection(directory: Path | None = None) -> tuple[tuple[str, str], ...]:
    """The paper's 43 categories: (the authors' file name, our node id)."""
    rows = table_rows((directory or taxonomy_directory()) / "paper_43.csv", ("list", "label", "node_id"), BadLevels)
    return tuple((row["label"], row["node_id"]) for _, row in rows)


def _candidate(node: Node, lists: Iterable[str]) -> CategoryCandidate | None:
    try:
        prior = node.prior()
    except NoPrior:
        return None
    nats = narrowing(prior)
    sd = math.exp(math.log(math.log(SCALE_RANGE)) - nats) / math.sqrt(2 * math.pi * math.e)
    return CategoryCandidate(node, prior, divergence(prior), tuple(lists), nats, sd)


def _misfit(one: CategoryCandidate, rules: Rules) -> str | None:
    """The first rule that a candidate breaks, with its figure."""
    if one.divergence > rules.most_divergence:
        return f"divergence {one.divergence:.2f}, over {rules.most_divergence:g}"
    if one.samples < rules.least_samples:
        return f"{one.samples} samples, under {rules.least_samples}"
    if one.prior.n_sources < rules.least_sources:
        return f"{one.prior.n_sources} sources, under {rules.least_sources}"
    if len(one.lists) < rules.least_lists:
        return f"in {len(one.lists)} of {len(TRAINING_LISTS)} training sets, under {rules.least_lists}"
    return None


def _lists_of_nodes(tree: Tree) -> Mapping[str, tuple[str, ...]]:
    """The training sets that name each node or one below it."""
    known = {node.node_id: node for node in tree}
    named: dict[str, dict[str, None]] = {}
    for name in TRAINING_LISTS:
        for label in vocabulary(name):
            node = known.get(label.node_id or "")
            while node is not None:
                named.setdefault(node.node_id, {})[name] = None
                node = node.parent
    return {node_id: tuple(lists) for node_id, lists in named.items()}


def _relative(one: CategoryCandidate, taken: Sequence[CategoryCandidate]) -> CategoryCandidate | None:
    """The one of those taken that lies above or below it in the tree."""
    above = _line(one.node)
    return next(
        (other for other in taken if other.node.node_id in above or one.node.node_id in _line(other.node)), None
    )


def _line(node: Node) -> set[str]:
    """Ids of a node and all above it."""
    line = {node.node_id}
    above = node.parent
    while above is not None:
        line.add(above.node_id)
        above = above.parent
    return line
