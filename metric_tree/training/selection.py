"""Choice of categories for instance segmentation and scale estimation, by the three rules of the paper (paper 3).

The paper chooses 43 categories by three rules: the sizes diverge little, the samples suffice, and well-known data sets
contain training images. This module computes the figure of each rule, and ranks the categories by their use: the
expected reduction of the entropy of the log scale by one object of the category. With u = ln scale, uniform over a
range R, and y = x - u 1 + noise the logarithms of the measured extents of an object,

    narrowing = ln R - E[ H(u | y) ],    p(u | y) ~ sum_k w_k N(y + u 1; m_k, S_k + B + N)

in nats, where S_k is the covariance within a source, B the covariance between sources (which the objects of a scene
share) and N the noise of the measurement. E is the expectation over objects of the prior.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.folders import taxonomy_directory
from metric_base.parsing import table_rows
from metric_tree.node import Node
from metric_tree.prior import Prior
from metric_tree.tree import Tree
from taxonomy.label_lists import vocabulary
from taxonomy.levels import BadLevels

#: Label lists of public data sets with instance masks: the three of the paper, and LVIS.
TRAINING_LISTS = ("coco_80", "ade20k_150", "openimages_601", "lvis_v1")

#: Standard deviation of ln size of a measured extent, as of complete objects in synthetic rooms.
MEASUREMENT_SD = 0.06

#: Ratio of the largest to the smallest scale: a unit of the reconstruction is a millimetre to a metre. It changes the
#: narrowing of all categories by the same amount, and no rank.
SCALE_RANGE = 1000.0

#: Number of objects for the expectation; its standard error is below 0.03 nats for every prior of the release.
MAX_DRAWS = 200

#: Grid of u around its true value, wider than the posterior of an object of any useful category.
GRID: FloatArray = np.arange(-4.0, 4.0, 0.02)


@dataclass(frozen=True, slots=True)
class Rules:
    """Thresholds of the three rules."""

    count: int = 43  #: Number of categories, that of the paper.
    #: Maximum divergence; beyond it ordinary objects differ twofold, or belong to different components of the prior.
    most_divergence: float = 0.5
    least_samples: int = 20  #: Minimum number of items; the standard error of a spread is one sixth.
    least_sources: int = 2  #: Minimum number of sources; the spread between sources is unknown with one.
    least_lists: int = 2  #: Minimum number of `TRAINING_LISTS`; names in one list are often specific to it.


@dataclass(frozen=True, slots=True, eq=False)
class CategoryCandidate:
    """A category with the figures of the rules."""

    node: Node
    prior: Prior
    divergence: float  #: Root mean square over the dimensions of the standard deviation of ln size.
    lists: tuple[str, ...]  #: Training lists with the category.
    narrowing: float  #: Nats.
    sd: float  #: Standard deviation of the Gaussian over ln scale with the expected entropy after one object.


def candidates(tree: Tree) -> list[CategoryCandidate]:
    """Return the nodes with a prior that a training list or the paper names, by descending narrowing.

    The lists of a candidate include those that name a node below it.
    """
    labels = {name: [label.node_id for label in vocabulary(name) if label.node_id] for name in TRAINING_LISTS}
    lists: defaultdict[str, dict[str, None]] = defaultdict(dict)
    for name, node_ids in labels.items():
        for node_id in node_ids:
            if tree.has_node(node_id):
                node = tree.node(node_id)
                for one in (node, *node.ancestors()):
                    lists[one.node_id][name] = None
    named = {node_id for node_ids in labels.values() for node_id in node_ids}
    named |= {node_id for _, node_id in paper_selection()}
    ranked = []
    for node in tree:
        if node.node_id in named and node.prior_dims:
            prior = node.prior()
            nats = narrowing(prior)
            sd = math.exp(math.log(math.log(SCALE_RANGE)) - nats) / math.sqrt(2 * math.pi * math.e)
            own_lists = tuple(lists.get(node.node_id, ()))
            ranked.append(CategoryCandidate(node, prior, divergence(prior), own_lists, nats, sd))
    return sorted(ranked, key=lambda one: (-one.narrowing, one.node.node_id))


def choose(ranked: Sequence[CategoryCandidate], rules: Rules | None = None) -> list[CategoryCandidate]:
    """Choose the `rules.count` candidates with the largest narrowing that comply with the rules.

    No chosen category is an ancestor of another, because a detector cannot learn chair and office chair as exclusive
    classes from data sets that label only one of them. Of two such candidates, the one in more training lists counts.
    """
    rules = rules or Rules()
    fit = [one for one in ranked if broken_rule(one, rules) is None]
    chosen: list[CategoryCandidate] = []
    for one in sorted(fit, key=lambda one: (-len(one.lists), -one.narrowing, one.node.node_id)):
        if relative(one, chosen) is None:
            chosen.append(one)
    return sorted(chosen, key=lambda one: (-one.narrowing, one.node.node_id))[: rules.count]


def reason_against(
    one: CategoryCandidate, taken: Sequence[CategoryCandidate], rules: Rules | None = None
) -> str | None:
    """Return the reason why a candidate is not among the chosen ones, or None if it is."""
    if any(one.node.node_id == other.node.node_id for other in taken):
        return None
    reason = broken_rule(one, rules or Rules())
    if reason is not None:
        return reason
    related = relative(one, taken)
    if related is not None:
        return f"above or below {related.node.name}, which is chosen"
    least = min((other.narrowing for other in taken), default=math.inf)
    return f"narrows by {one.narrowing:.2f} nats, under {least:.2f}"


def broken_rule(one: CategoryCandidate, rules: Rules) -> str | None:
    """Return the first rule that a candidate breaks with its figure, or None."""
    if one.divergence > rules.most_divergence:
        return f"divergence {one.divergence:.2f}, over {rules.most_divergence:g}"
    if one.prior.n < rules.least_samples:
        return f"{one.prior.n} samples, under {rules.least_samples}"
    if one.prior.n_sources < rules.least_sources:
        return f"{one.prior.n_sources} sources, under {rules.least_sources}"
    if len(one.lists) < rules.least_lists:
        return f"in {len(one.lists)} of {len(TRAINING_LISTS)} training sets, under {rules.least_lists}"
    return None


def relative(one: CategoryCandidate, others: Sequence[CategoryCandidate]) -> CategoryCandidate | None:
    """Return the first of the others that is the same node, an ancestor or a descendant, or None."""
    line = {one.node.node_id, *(above.node_id for above in one.node.ancestors())}
    for other in others:
        if other.node.node_id in line or any(above.node_id == one.node.node_id for above in other.node.ancestors()):
            return other
    return None


def divergence(prior: Prior) -> float:
    """Return the root mean square over the dimensions of the standard deviation of ln size of the mixture."""
    return float(np.sqrt((prior.log_sd() ** 2).mean()))


def narrowing(prior: Prior, noise: float = MEASUREMENT_SD, seed: int = 0) -> float:
    """Return the expected reduction of the entropy of ln scale by one object, in nats (equation of the module).

    Parameters
    ----------
    prior : Prior
        Prior of the category.
    noise : float
        Standard deviation of ln size of a measured extent.
    seed : int
        Seed of the objects that are drawn from the prior.
    """
    d = len(prior.dims)
    measured = replace(
        prior, covariances=prior.covariances + noise**2 * np.eye(d), shared_covariance=prior.disagreement()
    )
    y = np.log(measured.sample(MAX_DRAWS, seed))  # (n, d)
    covariance = measured.covariances + measured.shared_covariance  # (k, d, d)
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
    for k in range(len(prior.weights)):  # one by one; all components together take 100 MB
        density += peak[:, k, None] * np.exp(-0.5 * lam[k] * (GRID - centre[:, k, None]) ** 2)
    step = GRID[1] - GRID[0]
    density /= density.sum(axis=1, keepdims=True) * step
    entropy = -(density * np.log(np.maximum(density, 1e-300))).sum(axis=1) * step
    return math.log(math.log(SCALE_RANGE)) - float(entropy.mean())


def paper_selection(directory: Path | None = None) -> tuple[tuple[str, str], ...]:
    """Return the 43 categories of the paper: name of the authors' file, and node id."""
    rows = table_rows((directory or taxonomy_directory()) / "paper_43.csv", ("list", "label", "node_id"), BadLevels)
    return tuple((row["label"], row["node_id"]) for _, row in rows)


def selection_record(
    tree: Tree, all_candidates: Sequence[CategoryCandidate], chosen: Sequence[CategoryCandidate], rules: Rules
) -> dict[str, Any]:
    """Return a selection and, for comparison, that of the paper with reasons, as `metric-tree/select/1`."""
    labels = {node_id: label for label, node_id in paper_selection()}
    by_id = {candidate.node.node_id: candidate for candidate in all_candidates}
    chosen_ids = {candidate.node.node_id for candidate in chosen}
    paper: list[dict[str, Any]] = []
    for label, node_id in paper_selection():
        row: dict[str, Any] = {"node": node_id, "paper": label}
        reason: str | None = "no prior in this release"
        if (candidate := by_id.get(node_id)) is not None:
            row, reason = _candidate_record(candidate, label), reason_against(candidate, chosen, rules)
        paper.append({**row, "chosen": node_id in chosen_ids, "reason": reason})
    return {
        "schema": "metric-tree/select/1",
        "tree": {"name": tree.name, "version": tree.version},
        "rules": {name: getattr(rules, name) for name in Rules.__dataclass_fields__},
        "candidates": len(all_candidates),
        "chosen": [_candidate_record(candidate, labels.get(candidate.node.node_id)) for candidate in chosen],
        "paper": paper,
    }


def _candidate_record(candidate: CategoryCandidate, paper_label: str | None) -> dict[str, Any]:
    return {
        "node": candidate.node.node_id,
        "name": candidate.node.name,
        "dims": list(candidate.prior.dims),
        "divergence": round(candidate.divergence, 3),
        "samples": candidate.prior.n,
        "sources": candidate.prior.n_sources,
        "lists": list(candidate.lists),
        "sd": round(candidate.sd, 3),
        "narrowing": round(candidate.narrowing, 3),
        "paper": paper_label,
    }


def named_nodes(tree: Tree, categories: str | None) -> list[Node]:
    """Return the nodes of a file of `metric-tree select --out`, of names with commas, or of the default selection.

    Raises
    ------
    InputError
        A name or an id is unknown, the file has no column `node`, or the rules choose no category.
    """
    if categories is None:
        ranked = candidates(tree)
        chosen = [candidate.node for candidate in choose(ranked)]
        if not chosen:
            count = f"none of {len(ranked)} candidates of {tree.name} {tree.version}"
            raise InputError(f"--categories: expected names, as select's rules chose no category; found {count}")
        return chosen
    if not categories.endswith(".csv"):
        return [tree.find(name.strip()) for name in categories.split(",")]
    nodes = []
    for place, row in table_rows(Path(categories), ("node",)):
        try:
            nodes.append(tree.node(row["node"]))
        except InputError as error:
            raise InputError(f"{place}: {error}") from None
    if not nodes:
        raise InputError(f"{categories}: expected rows, as `metric-tree select --out` writes them; found none")
    return nodes
