"""A category in words: how large such objects are, and what is known of it by kind of evidence and licence."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from metric_base.errors import InputError
from metric_tree.node import Node
from metric_tree.prior import INTERVAL_QUANTILES, Prior
from metric_tree.tiers import tier_words

#: Kinds of evidence of items (`metric_tree.release.schema.ITEMS`).
KINDS = ("measured", "product", "standard", "norm", "statistic", "judged", "curated", "asset", "museum", "default")

#: Items of one node are mixed where the 95th of a hundred is so many times the 5th.
MIXED_RATIO = 10.0

#: A height under this part of the longest axis is no size that people name: a rug is 2 m long, and not 1 cm high.
FLAT = 0.25

#: Ends of the 90 % interval under this ratio take more digits, as of a size that a norm fixes.
NARROW = 1.1

#: As many children as the sentence of a mixed node names.
MOST_CHILDREN = 8

_AXES = {"height": "high", "length": "long", "width": "wide"}

#: Last words of names that have no singular: a pair of scissors is one object.
_PLURALS = (
    "binoculars bellows earbuds earphones glasses goggles handcuffs headphones jeans leggings loppers pajamas pants "
    "pliers scales scissors shears shorts skis spectacles stairs sunglasses suspenders tights tongs trousers trunks "
    "tweezers"
)

#: Beginnings with a vowel that are said as "you": a Euro pallet, a unicycle, a utensil.
_SAID_AS_YOU = ("eu", "uni", "use", "ute")

_COLUMNS = ("length_mm", "width_mm", "height_mm")


def everyday_sentence(name: str, prior: Prior) -> str:
    """The median and the 90 % interval of the main axis in words.

    `A mug is about 9.5 cm high; nine of ten are 8 to 12 cm.` The axis is the height where the prior has one, else the
    first of its dimensions; of what is flat or long (a disc, a train), the longest. What the size rests on stands
    before it, unless it is measured.

    Parameters
    ----------
    name : what the object is called.
    prior : its sizes in mm.
    """
    place = _main_axis(prior)
    low, middle, high = prior.quantiles(INTERVAL_QUANTILES)[:, place].tolist()
    how = _AXES.get(prior.dims[place], "across")
    article = "An" if name[:1].lower() in "aeiou" and not name.lower().startswith(_SAID_AS_YOU) else "A"
    plural = name.rpartition(" ")[2].lower() in _PLURALS.split()
    subject = f"{name[:1].upper()}{name[1:]} are" if plural else f"{article} {name} is"
    unit, factor = _unit(middle)
    ground = "" if prior.tier == "measured" else f"{tier_words(prior.tier, prior.norm)}: "
    if ground and not (plural and name[:2].isupper()):
        subject = subject[:1].lower() + subject[1:]
    digits = 4 if high < NARROW * low else 2
    sizes = [_number(size / factor, digits) for size in (middle, low, high)]
    return f"{ground}{subject} about {sizes[0]} {unit} {how}; nine of ten are {sizes[1]} to {sizes[2]} {unit}."


def _main_axis(prior: Prior) -> int:
    """The number of the axis that a sentence is about."""
    medians = prior.quantile(0.5)
    place = prior.dims.index("height") if "height" in prior.dims else 0
    return place if medians[place] >= FLAT * medians.max() else int(np.argmax(medians))


def is_mixed(node: Node, prior: Prior) -> bool:
    """Return True if the 90 % interval of an inner node spans more than a factor of `MIXED_RATIO`."""
    low, high = prior.interval(0.9).T
    return bool(node.children) and bool(np.any(high > MIXED_RATIO * low))


def node_sentence(node: Node, name: str, prior: Prior) -> str:
    """As `everyday_sentence`; of a node that is mixed, its children in place of a number.

    Parameters
    ----------
    node : the node; name : what it is called; prior : its sizes in mm
    """
    if not is_mixed(node, prior):
        return everyday_sentence(name, prior)
    children = sorted(node.children, key=lambda child: -child.n_items)
    names = ", ".join(child.name.partition(" (")[0] for child in children[:MOST_CHILDREN])
    more = f" and {len(children) - MOST_CHILDREN} more" if len(children) > MOST_CHILDREN else ""
    subject = name[:1].upper() + name[1:]
    return f"{subject}: mixed, nine of ten differ by more than {MIXED_RATIO:g} times; ask for one of {names}{more}."


def shipped_evidence(node: Node) -> dict[str, dict[str, int]]:
    """How many shipped items at or below a node are of each kind, and under each licence, the most first."""
    items = node.items(("kind", "licence"))
    counts = {name: Counter(value or "unstated" for value in items[name].to_pylist()) for name in items.column_names}
    return {name: dict(count.most_common()) for name, count in counts.items()}


def item_quantiles(node: Node, kind: str, quantiles: tuple[float, ...]) -> dict[str, Any]:
    """Counts and quantiles in mm of the shipped items of one kind, by dimension; a dimension without any is left out.

    Raises
    ------
    metric_base.errors.InputError
        No such kind, or no shipped item of it.
    """
    if kind not in KINDS:
        raise InputError(f"--kind: expected one of {', '.join(KINDS)}; found {kind!r}")
    items = node.items()
    rows = [row for row in items.select(["kind", *_COLUMNS]).to_pylist() if row["kind"] == kind]
    if not rows:
        there = ", ".join(shipped_evidence(node)["kind"]) or "no item at all"
        raise InputError(f"--kind: expected a kind that {node.node_id} has shipped items of ({there}); found {kind!r}")
    sizes = np.array([[row[column] for column in _COLUMNS] for row in rows], dtype=float)  # (n, 3), NaN where missing
    table: dict[str, dict[str, float]] = {}
    for column, values in zip(_COLUMNS, sizes.T, strict=True):
        known = values[~np.isnan(values)]
        if known.size:
            table[column.removesuffix("_mm")] = {
                f"{q:g}": round(float(value), 2)
                for q, value in zip(quantiles, np.quantile(known, quantiles), strict=True)
            }
    return {"kind": kind, "n": len(rows), "quantiles_mm": table}


def _unit(mm: float) -> tuple[str, float]:
    return ("m", 1000.0) if mm >= 1000 else ("cm", 10.0) if mm >= 20 else ("mm", 1.0)


def _number(value: float, digits: int) -> str:
    """At least so many digits, and no fewer than the whole units."""
    return f"{value:.0f}" if value >= 20 and digits == 2 else f"{value:.{digits}g}"
