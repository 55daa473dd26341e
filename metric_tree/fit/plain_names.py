"""How common the children of a node are, and which of them people mean by its plain name.

Children count by how common the objects are, not pages. Where a reviewer has stated how often people mean which child
by the plain name (`data/curated/frequencies.csv`), that holds. Else the leaf of objects that are called by the plain
name alone has at least `PLAIN_SHARE`, and every source is one witness of the shares of the others among its own items,
whether it lists a hundred or a hundred thousand, so that one shop's range does not drown what others show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.prior import Prior
from taxonomy.categories import Category

__all__ = ["REAL_WITNESS", "WITNESS", "commonness", "is_called", "is_part", "plain_weights", "presence"]

#: Items below a node at which a source has half of a witness's weight: shares among ten are known to a sixth.
WITNESS_HALF = 10.0

#: Weight of the leaf `<id>/other` in its node: of objects of 97 kinds that have thirty labels or more in ScanNet and
#: Matterport3D, annotators give 79 % the plain name, on average over the kinds (half of the kinds: 97 % and more).
PLAIN_SHARE = 0.8

#: Last words of the names of parts, and of objects for another object: a toilet seat, a knife set, a mirror cabinet.
PART_WORDS = frozenset({
    "cab", "cabinet", "cover", "frame", "front", "handle", "holder", "insert", "leg", "lid", "part", "piece", "seat",
    "set", "stand", "tank", "tool", "topper", "trailer", "tray",
})  # fmt: skip

#: How far a source of a kind is a witness of how common objects are. Measured rooms and streets show it, shops
#: show what is bought, artists what they like to draw; what a museum keeps is rare.
WITNESS = {
    "measured": 1.0,
    "product": 0.5,
    "standard": 0.1,
    "asset": 0.2,
    "museum": 0.01,
    "default": 0.1,
    "judged": 0.0,
    "norm": 0.0,
    "statistic": 0.0,
}

#: Sources of products, measurements and tables of norms have this or more.
REAL_WITNESS = 0.5

#: Part of the weight that all children share alike, for those that no witness holds ...
EQUAL_SHARE = 0.1

#: ... and more of it while the witnesses together weigh little against this: two models of toys say nothing of what is
#: common on a street.
EQUAL_WITNESS = 0.5

#: How far a child that only this kind of evidence speaks of is an object of today, in what all children share
#: alike. What a museum alone keeps is not what people mean.
PRESENCE = {"museum": 0.02, "default": 0.3, "asset": 0.5}


def presence(children: Sequence[Sequence[Prior]]) -> FloatArray:
    """How far each child is an object of today, (c,), by the kinds of evidence in its prior (`PRESENCE`)."""
    shares = (own[0].share_by_kind if own else {} for own in children)
    return np.array([sum(PRESENCE.get(kind, 1.0) * part for kind, part in one.items()) or 1.0 for one in shares])


def commonness(
    counts: Sequence[Mapping[str, int]], trust: Mapping[str, float], present: FloatArray | None = None
) -> FloatArray:
    """How common each child is, (c,), sum 1: its share in each source, averaged over the sources.

    Parameters
    ----------
    counts : items by source of each child; trust : weight of a source's kind (`WITNESS`)
    present : (c,) parts of what all children share alike (`presence`); the same for all by default
    """
    equal = np.full(len(counts), 1 / len(counts)) if present is None else present / present.sum()
    sources = sorted({source for count in counts for source in count})
    items = np.array([[count.get(source, 0) for source in sources] for count in counts], dtype=float)  # (c, s)
    below = items.sum(axis=0)
    witness = np.array([trust[source] for source in sources]) * below / (below + WITNESS_HALF)
    if not witness.sum() > 0:
        return equal
    alike = max(EQUAL_SHARE, EQUAL_WITNESS / (EQUAL_WITNESS + witness.sum()))
    shares: FloatArray = alike * equal + (1 - alike) * (items / below) @ witness / witness.sum()
    return shares


def plain_weights(
    node_id: str,
    children: Sequence[str],
    common: FloatArray,
    stated: Mapping[str, float] | None = None,
    kinds: Sequence[bool] | None = None,
) -> FloatArray:
    """Weight of each child in what people call by the node's plain name, (c,), sum 1.

    Parameters
    ----------
    common : (c,) how common each child is; stated : a reviewer's weights by child, which hold where there are any
    kinds : (c,) whether the child is called by the plain name; where objects of the plain name have a leaf, the others
        weigh nothing: an ironing board hangs on `iron`, and nobody calls it so
    """
    if stated and (total := sum(stated.get(child, 0.0) for child in children)) > 0:
        return np.array([stated.get(child, 0.0) / total for child in children])
    parts = np.array([is_part(child, node_id) for child in children])
    if parts.any() and not parts.all():
        common = np.where(parts, 0.0, common) / max(float(common[~parts].sum()), 1e-12)
    plain = np.array([child == f"{node_id}/other" for child in children])
    if not plain.any() or plain.all():
        return common
    if kinds is not None:
        called = np.where(np.asarray(kinds) | plain, common, 0.0)
        common = called / called.sum() if called.sum() > 0 else plain / plain.sum()
    if not common[~plain].any():
        return np.asarray(plain / plain.sum())
    least = max(PLAIN_SHARE, float(common[plain].sum()))
    return np.where(plain, least, common * (1 - least) / max(float(common[~plain].sum()), 1e-12))


def is_part(child_id: str, node_id: str) -> bool:
    """Whether a child is a part of the node, or an object for it, by its name: a toilet seat is no toilet.

    >>> is_part("toilet_seat.n.01", "toilet.n.02"), is_part("flush_toilet.n.01", "toilet.n.02")
    (True, False)
    """
    child, node = (name.removeprefix("mt:").partition(".n.")[0] for name in (child_id, node_id))
    return child.startswith(f"{node}_") and child.rpartition("_")[2] in PART_WORDS


def is_called(child: Category, node: Category) -> bool:
    """Whether people call a child by the node's plain name: a kind of it in WordNet, or its name ends in that of it.

    A steam iron is an iron, and an ironing board is none.
    """
    if node.synset is not None and node.synset in child.hypernyms:
        return True
    plain = {name.lower() for name in (node.name, *node.aliases)}
    names = (name.lower().replace("-", " ") for name in (child.name, *child.aliases))
    return any(name in plain or any(name.endswith(f" {one}") for one in plain) for name in names)
