"""A category in words: its size in a sentence, and its items by kind of evidence and licence."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from metric_base.errors import InputError
from metric_tree.node import Node
from metric_tree.prior import INTERVAL_QUANTILES, Prior
from metric_tree.tiers import tier_words
from taxonomy.words.phrases import word_list

#: Kinds of evidence of items (`metric_tree.release.schema.ITEMS`).
KINDS = ("measured", "product", "standard", "norm", "statistic", "judged", "curated", "asset", "museum", "default")

#: Ratio of the 95th to the 5th percentile above which the objects of an inner node are heterogeneous.
MIXED_RATIO = 10.0

#: Minimum height of a sentence about heights, as a fraction of the longest axis: a rug is 2 m long, not 1 cm high.
MIN_HEIGHT_FRACTION = 0.25

#: Ratio of the ends of the 90 % interval below which sizes have four digits, as the size of a norm.
NARROW_RATIO = 1.1

#: Sizes from which a sentence uses cm and m, in mm.
CM_FROM_MM, M_FROM_MM = 20, 1000

#: Maximum number of children in the sentence of a heterogeneous node.
MAX_CHILDREN = 8

_AXES = {"height": "high", "length": "long", "width": "wide"}

#: Words after the main noun of a name: a chest of drawers, a chair with armrests, scooters for adults, a work on paper.
_PREPOSITIONS = (" of ", " with ", " for ", " on ")

#: First letters of abbreviations with the article "an": an LP record.
_VOWEL_NAMES = "AEFHILMNORSX"
#: Names in capital letters that are spoken as words.
_SPOKEN_NAMES = ("LEGO",)

#: First letters with the article "a" although they are vowels: a Euro pallet, a one dollar coin, a unicycle, a utensil;
#: but an uninterruptible power supply.
_CONSONANT_SOUNDS = ("eu", "one ", "unic", "unif", "unio", "unit", "univ", "use", "ute", "uti")
#: Words with "and" that describe one object; other names with "and" are those of a group of categories.
_JOINED_WORDS = ("hundred and", "red and white")

_COLUMNS = ("length_mm", "width_mm", "height_mm")


def subject_and_verb(name: str) -> str:
    """Return the beginning of a sentence about a category, with an article if its name is that of countable objects.

    >>> subject_and_verb("mug"), subject_and_verb("LP record"), subject_and_verb("brown rice")
    ('A mug is', 'An LP record is', 'Brown rice is')
    >>> subject_and_verb("pruning shears"), subject_and_verb("jean"), subject_and_verb("door and doorframe")
    ('Pruning shears are', 'Jeans are', 'Objects of the category door and doorframe are')
    """
    main_noun = name.partition(" (")[0]
    if " and " in main_noun and not any(words in name for words in _JOINED_WORDS):
        return f"Objects of the category {name} are"
    for word in _PREPOSITIONS:
        main_noun = main_noun.partition(word)[0]
    words = main_noun.lower().split(" ")
    endings = {words[-1], "_".join(words[-2:])}
    if words[-1] in word_list("used_in_plural"):
        name = name.removesuffix("y") + "ies" if name.endswith("y") else name + "s"
    elif not endings & word_list("plurals"):
        if endings & word_list("mass_nouns") or words[-1].endswith(("ware", "wear")):
            return f"{name[:1].upper()}{name[1:]} is"
        first = name.partition(" ")[0].rstrip("0123456789")  # an R14 bulb
        if first.isupper() and first.isalpha() and first not in _SPOKEN_NAMES:
            starts_with_vowel = first[0] in _VOWEL_NAMES
        else:
            starts_with_vowel = name[:1].lower() in "aeiou" and not name.lower().startswith(_CONSONANT_SOUNDS)
            starts_with_vowel = starts_with_vowel or name.lower().startswith("hour")
        return f"{'An' if starts_with_vowel else 'A'} {name} is"
    return f"{name[:1].upper()}{name[1:]} are"


def everyday_sentence(name: str, prior: Prior) -> str:
    """Return the median and the 90 % interval of the main axis in words.

    For example `A mug is about 9.5 cm high; nine of ten are 8 to 12 cm.` The main axis is the height if the prior has
    one, otherwise its first dimension; for flat or long objects (a disc, a train) it is the longest. The tier precedes
    the sentence unless it is `measured`.
    """
    medians = prior.quantile(0.5)
    axis = prior.dims.index("height") if "height" in prior.dims else 0
    axis = axis if medians[axis] >= MIN_HEIGHT_FRACTION * medians.max() else int(np.argmax(medians))
    low, median, high = prior.quantiles(INTERVAL_QUANTILES)[:, axis].tolist()
    subject = subject_and_verb(name)
    tier = "" if prior.tier == "measured" else f"{tier_words(prior.tier, prior.norm)}: "
    if tier and not subject[1].isupper():
        subject = subject[:1].lower() + subject[1:]
    unit, factor = ("m", 1000.0) if median >= M_FROM_MM else ("cm", 10.0) if median >= CM_FROM_MM else ("mm", 1.0)
    digits = 4 if high < NARROW_RATIO * low else 2
    values = [size / factor for size in (median, low, high)]
    # two digits, but complete units
    sizes = [f"{value:.0f}" if value >= 20 and digits == 2 else f"{value:.{digits}g}" for value in values]
    adjective = _AXES.get(prior.dims[axis], "across")
    return f"{tier}{subject} about {sizes[0]} {unit} {adjective}; nine of ten are {sizes[1]} to {sizes[2]} {unit}."


def is_heterogeneous(node: Node, prior: Prior) -> bool:
    """Return True if the 90 % interval of an inner node spans more than a factor of `MIXED_RATIO`."""
    low, high = prior.interval(0.9).T
    return bool(node.children) and bool(np.any(high > MIXED_RATIO * low))


def node_sentence(node: Node, name: str, prior: Prior) -> str:
    """Return `everyday_sentence`, or the children of a heterogeneous node instead of a size."""
    if not is_heterogeneous(node, prior):
        return everyday_sentence(name, prior)
    children = sorted(node.children, key=lambda child: -child.n_items)
    names = ", ".join(child.name.partition(" (")[0] for child in children[:MAX_CHILDREN])
    more = f" and {len(children) - MAX_CHILDREN} more" if len(children) > MAX_CHILDREN else ""
    subject = name[:1].upper() + name[1:]
    return f"{subject}: mixed, nine of ten differ by more than {MIXED_RATIO:g} times; ask for one of {names}{more}."


def shipped_evidence(node: Node) -> dict[str, dict[str, int]]:
    """Return the number of shipped items at or below a node by kind and by licence, the most first."""
    items = node.items(("kind", "licence"))
    counts = {name: Counter(value or "unstated" for value in items[name].to_pylist()) for name in items.column_names}
    return {name: dict(count.most_common()) for name, count in counts.items()}


def item_quantiles(node: Node, kind: str, quantiles: tuple[float, ...]) -> dict[str, Any]:
    """Return the number and the quantiles in mm of the shipped items of one kind, by dimension if an item states it.

    Raises
    ------
    metric_base.errors.InputError
        The kind does not exist, or has no shipped item.
    """
    if kind not in KINDS:
        raise InputError(f"--kind: expected one of {', '.join(KINDS)}; found {kind!r}")
    rows = [row for row in node.items().select(["kind", *_COLUMNS]).to_pylist() if row["kind"] == kind]
    if not rows:
        there = ", ".join(shipped_evidence(node)["kind"]) or "no item at all"
        raise InputError(f"--kind: expected a kind that {node.node_id} has shipped items of ({there}); found {kind!r}")
    sizes = np.array([[row[column] for column in _COLUMNS] for row in rows], dtype=float)  # (n, 3), NaN if missing
    table: dict[str, dict[str, float]] = {}
    for column, values in zip(_COLUMNS, sizes.T, strict=True):
        known = values[~np.isnan(values)]
        if known.size:
            table[column.removesuffix("_mm")] = {
                f"{q:g}": round(float(value), 2)
                for q, value in zip(quantiles, np.quantile(known, quantiles), strict=True)
            }
    return {"kind": kind, "n": len(rows), "quantiles_mm": table}
