"""Rows that say the same object twice: of one source, and of one product in two sources."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.fit.rows import KIND_WEIGHT

#: Sizes that agree to this share are the same figure, whatever unit it went through: a millimetre of a sofa.
SAME_SIZE_SHARE = 0.0005

#: Stands for a size that is not stated; no ln size comes near it.
MISSING = -(10**9)

#: A word of a title that can tell one product from another is at least this long.
MIN_WORD_LETTERS = 3

_WORDS = re.compile(r"[^\W_]+")


def duplicates(
    node: Sequence[str],
    sizes: FloatArray,
    source: Sequence[str],
    kind: Sequence[str],
    title: Sequence[str],
    shipped: Sequence[bool],
    common: frozenset[str] = frozenset(),
) -> NDArray[np.intp]:
    """For each row the row it repeats, -1 where it is the first of its like; (n,).

    Within a source and a node: the same two or three different numbers, or one number under the same title; people,
    fish and trees that were measured one by one are never repeats. Across sources: the same three extents and a
    telling word in both titles. The row kept is one that ships, then of the stronger kind, then the first.

    Parameters
    ----------
    sizes : (n, 6) mm, length, width, height, extents, NaN where missing
    common : words that tell nothing (names of the categories)
    """
    rounded = np.nan_to_num(np.round(np.log(sizes) / SAME_SIZE_SHARE), nan=MISSING).astype(np.int64)
    rank = [(not shipped[i], -KIND_WEIGHT.get(kind[i], 0.0), i) for i in range(len(node))]
    repeats = np.full(len(node), -1, dtype=np.intp)
    first: dict[tuple[object, ...], int] = {}
    across: dict[tuple[object, ...], list[tuple[int, frozenset[str]]]] = {}
    for row in sorted(range(len(node)), key=rank.__getitem__):
        own = rounded[row].tolist()
        telling = len({number for number in own[3:] if number != MISSING}) >= 2
        if kind[row] != "measured":
            key = (node[row], source[row], *own, "" if telling else title[row].casefold())
            repeats[row] = first.setdefault(key, row)
        if telling and own[5] != MISSING and repeats[row] in (-1, row):
            same_size = across.setdefault((node[row], *own[3:]), [])
            words = _words(title[row]) - common
            for other, other_words in same_size:
                if source[other] != source[row] and words & other_words:
                    repeats[row] = other
            same_size.append((row, words))
    repeats[repeats == np.arange(len(node))] = -1
    return repeats


def _words(title: str) -> frozenset[str]:
    return frozenset(word for word in _WORDS.findall(title.casefold()) if len(word) >= MIN_WORD_LETTERS)
