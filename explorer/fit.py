"""The probability that one object fits through another one (a door) or into it (a car), from the priors of both.

An object with the sorted sides a <= b <= c passes straight through an opening with the sides p <= q if a <= p and
b <= q, and fits into a box with the sorted sides p <= q <= r if a <= p, b <= q and c <= r. Both allow quarter turns,
not tilts. The sides of a category that is a container are its outer ones, which bound the inner ones; the probability
is then an upper bound. `assets/compare.js` computes the same from the same numbers.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from explorer.catalogue import ReleaseCatalogue
from explorer.charts.axis import length_text
from explorer.responses import found_node, shown_name, tree_reference
from explorer.schemas import FitAnswer, FitQuery
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.length_units import MILLIMETRES
from metric_tree.node import Node
from metric_tree.prior import Prior

#: Nodes whose objects are openings: things pass through them.
OPENINGS = frozenset({"door.n.01", "window.n.01"})
#: Number of simulated pairs: the standard error of the probability is at most 0.4 percentage points.
N_PAIRS = 20_000
#: Significant digits of the parameters of a prior: an error of a length of at most 0.1 %.
DIGITS = 4
#: Range of a side that a user states, in mm: smaller or larger ones are mistakes of units.
MIN_SIDE_MM, MAX_SIDE_MM = 0.1, 1e6

_SIDES = re.compile(r"\s*(\d+(?:\.\d+)?(?:\s*[x×*]\s*\d+(?:\.\d+)?){1,2})\s*(mm|cm|m|in|ft)?\s*", re.IGNORECASE)
_RANKS = {2: ("shorter side", "longer side"), 3: ("shortest side", "middle side", "longest side")}


def stated_sides(text: str) -> list[float] | None:
    """Return the sides in mm of a text such as `210 x 95 x 85 cm` (cm is the default); None if it is a name.

    Raises
    ------
    InputError
        A side is below `MIN_SIDE_MM` or above `MAX_SIDE_MM`.
    """
    match = _SIDES.fullmatch(text)
    if match is None:
        return None
    sides = [float(side) * MILLIMETRES[(match[2] or "cm").lower()] for side in re.split(r"[x×*]", match[1])]
    if not all(MIN_SIDE_MM <= side <= MAX_SIDE_MM for side in sides):
        raise InputError(f"sides: expected {MIN_SIDE_MM:g} to {MAX_SIDE_MM:g} mm; found {text.strip()[:60]!r}")
    return sides


def fit_response(catalogue: ReleaseCatalogue, query: FitQuery) -> FitAnswer:
    """Return the probability that an object fits, with its reason; the probability is None if a side is not known.

    Raises
    ------
    InputError
        A text is neither a name nor sides, or a side is out of range.
    """
    names: list[str] = []
    nodes: list[Node | None] = []
    samples: list[FloatArray] = []
    for seed, text in enumerate((query.object, query.into), 1):
        sides = stated_sides(text)
        node = found_node(catalogue, text) if sides is None else None
        prior = catalogue.prior(node) if node is not None else None
        nodes.append(node)
        names.append(shown_name(node) if node is not None else text.strip())
        if sides is not None:
            samples.append(np.array([sides]))
        else:
            samples.append(random_sizes(prior, seed) if prior is not None else np.zeros((1, 0)))
    target = nodes[1]
    is_opening = target is not None and any(one.node_id in OPENINGS for one in (target, *target.ancestors()))
    if target is None:
        is_opening = samples[1].shape[1] == 2
    how = query.how or ("through" if is_opening else "in")
    if how == "through" and target is not None and {"length", "height"} <= set(catalogue.dims(target)):
        samples[1] = samples[1][:, [catalogue.dims(target).index(dim) for dim in ("length", "height")]]
    fields: dict[str, Any] = {
        "tree": tree_reference(catalogue.tree),
        "object": names[0],
        "into": names[1],
        "nodes": [node.node_id if node is not None else None for node in nodes],
        "how": how,
        "is_upper_bound": how == "in" and target is not None,
    }
    needed = (3, 2 if how == "through" else 3)
    for name, sizes, count in zip(names, samples, needed, strict=True):
        if sizes.shape[1] < count:
            reason = f"Not known: {sizes.shape[1] or 'none'} of the {count} necessary sides of {name} are known."
            return FitAnswer(**fields, probability=None, reason=reason)
    probability, reason = probability_and_reason(names, samples, how)
    if fields["is_upper_bound"]:
        reason += f"These are outer sides of {names[1]}; its inside is smaller, so the true probability is lower."
    elif how == "through":
        reason += "Straight, with quarter turns; tilting is not considered."
    return FitAnswer(**fields, probability=probability, reason=reason.rstrip())


def mixture_table(prior: Prior) -> list[list[float]]:
    """Return weight, means (d) and lower Cholesky factor (d (d + 1) / 2, by row) of ln mm for each component."""
    lower = np.linalg.cholesky(prior.covariances + prior.shared_covariance)[:, *np.tril_indices(len(prior.dims))]
    table = np.concatenate([prior.weights[:, None], prior.means, lower], axis=1)
    return [[float(f"{value:.{DIGITS}g}") for value in row] for row in table.tolist()]


def random_sizes(prior: Prior, seed: int) -> FloatArray:
    """Return `N_PAIRS` random objects of a prior, (n, d) in mm, by the generator mulberry32 of `assets/compare.js`."""
    d = len(prior.dims)
    table = np.array(mixture_table(prior))
    step, shift = np.uint32(0x6D2B79F5), np.uint32
    state = shift(seed) + step * np.arange(1, N_PAIRS * (1 + 2 * d) + 1, dtype=np.uint32)
    mixed = (state ^ (state >> shift(15))) * (state | shift(1))
    mixed ^= mixed + (mixed ^ (mixed >> shift(7))) * (mixed | shift(61))
    uniform = ((mixed ^ (mixed >> shift(14))) / 2**32).reshape(N_PAIRS, 1 + 2 * d)
    total = np.cumsum(table[:, 0])
    component = np.searchsorted(total[:-1], uniform[:, 0] * total[-1], side="right")
    white = np.sqrt(-2 * np.log(1 - uniform[:, 1::2])) * np.cos(2 * np.pi * uniform[:, 2::2])  # Box and Muller
    lower = np.zeros((len(table), d, d))
    lower[:, *np.tril_indices(d)] = table[:, 1 + d :]
    sizes: FloatArray = np.exp(table[component, 1 : 1 + d] + np.einsum("nij,nj->ni", lower[component], white))
    return sizes


def probability_and_reason(names: list[str], samples: list[FloatArray], how: str) -> tuple[float, str]:
    """Return the probability that a random object of `samples[0]` (n, 3) fits one of `samples[1]` (m, 2 or 3), in mm.

    The reason names the pair of sides that fits least often, with its medians.
    """
    n = max(len(sizes) for sizes in samples)
    own, room = (np.broadcast_to(np.sort(sizes, axis=1), (n, sizes.shape[1])) for sizes in samples)
    ranks = _RANKS[room.shape[1]] if how == "in" else _RANKS[2]
    own, room = own[:, : len(ranks)], room[:, -len(ranks) :]
    fits = own <= room  # (n, 2 or 3)
    probability = float(fits.all(axis=1).mean())
    tight = int(np.argmin(fits.mean(axis=0)))
    own_rank = _RANKS[3][tight]
    medians = [length_text(float(f"{np.median(sizes[:, tight]):.3g}")) for sizes in (own, room)]
    share = math.floor(100 * float(fits[:, tight].mean()) + 0.5)
    reason = (
        f"The {own_rank} of {names[0]} is about {medians[0]}, the {ranks[tight]} of {names[1]} about {medians[1]}: "
        f"on this side {share} % of the pairs fit. "
    )
    return round(probability, 3), reason
