"""Rows that repeat an object: within a source, and of one product in two sources."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.fit.rows import KIND_WEIGHT

#: Relative width of the bins in which two sizes are the same number after conversions of units: 1 mm for a sofa.
SIZE_RELATIVE_TOLERANCE = 0.0005

#: Code of a size that is not stated, far below every ln size.
MISSING = -(10**9)

#: Minimum length of a word of a title that identifies a product.
MIN_WORD_LETTERS = 3

_WORDS = re.compile(r"[^\W_]+")


def size_codes(sizes: FloatArray) -> NDArray[np.int64]:
    """Return integers (n, k) that are equal for sizes (n, k) in mm that are the same number."""
    return np.nan_to_num(np.round(np.log(sizes) / SIZE_RELATIVE_TOLERANCE), nan=MISSING).astype(np.int64)


def extent_codes(extents: FloatArray) -> NDArray[np.int64]:
    """Return an integer (n,) of the extents (n, 3) in mm of each row, which is equal for duplicates.

    The sizes of one class are close, so that the code is spread by multiplicative hashing (Knuth 1998, 6.4).
    """
    codes = size_codes(extents) @ np.array([1, 1_000_003, 1_000_003**2])
    return np.asarray((codes.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15) >> np.uint64(24)).astype(np.int64))


def duplicates(
    node: Sequence[str],
    sizes: FloatArray,
    source: Sequence[str],
    kind: Sequence[str],
    title: Sequence[str],
    shipped: Sequence[bool],
    common: frozenset[str] = frozenset(),
) -> NDArray[np.intp]:
    """Return the row that each row repeats, (n,), or -1.

    Within a source and a node, rows are repeats if they have the same two or three different sizes, or one size and the
    same title; rows of the kind `measured` never are, because people, fish and trees were measured individually. Across
    sources, rows are repeats if they have the same three extents, of which two differ, and a common identifying word in
    the title. The row that is not a repeat is one that is shipped, then of the stronger kind, then the first.

    Parameters
    ----------
    node, source, kind, title : (n,) sequence of str
        Columns of the rows.
    sizes : (n, 6) float
        Length, width, height and extents in mm, NaN if missing.
    shipped : (n,) sequence of bool
        Whether the source of the row may be redistributed.
    common : frozenset of str
        Words that identify nothing: the names of the categories.
    """
    rounded = size_codes(sizes)
    rank = [(not shipped[i], -KIND_WEIGHT.get(kind[i], 0.0), i) for i in range(len(node))]
    repeats = np.full(len(node), -1, dtype=np.intp)
    first: dict[tuple[object, ...], int] = {}
    across: dict[tuple[object, ...], list[tuple[int, frozenset[str]]]] = {}
    for row in sorted(range(len(node)), key=rank.__getitem__):
        codes = rounded[row].tolist()
        has_several = len({code for code in codes[3:] if code != MISSING}) >= 2
        if kind[row] != "measured":
            key = (node[row], source[row], *codes, "" if has_several else title[row].casefold())
            repeats[row] = first.setdefault(key, row)
        if has_several and codes[5] != MISSING and repeats[row] in (-1, row):
            same_size = across.setdefault((node[row], *codes[3:]), [])
            long_words = (word for word in _WORDS.findall(title[row].casefold()) if len(word) >= MIN_WORD_LETTERS)
            words = frozenset(long_words) - common
            for other, other_words in same_size:
                if source[other] != source[row] and words & other_words:
                    repeats[row] = other
            same_size.append((row, words))
    repeats[repeats == np.arange(len(node))] = -1
    return repeats
