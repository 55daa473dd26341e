"""Damage files: flipped, missing and repeated bytes, and numbers and words replaced by values that cause errors."""

from __future__ import annotations

import re

import numpy as np

__all__ = ["mutated"]

#: Replacements of a number or a word of a text file.
HOSTILE = (
    b"NaN", b"Infinity", b"-1", b"0", b"1e308", b"1e-320", b"9" * 400, b"18446744073709551615", b"-0.0", b"null",
    b"true", b"[]", b"{}", b'""', b"[[[[[[[[]]]]]]]]", b'"\\u0000"', b'"\\ud800"', b'"../../x"', b"\x1b[2J",
    b"\xff\xfe", b"1" * 5000, b"4294967296", b"2147483648", b"1.5", b"\n", b",", b"#",
)  # fmt: skip
_WORD = re.compile(rb'-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?|"[^"\n]{0,40}"|true|false|null|[A-Za-z_]{2,}')
#: Replacements of integers and floats of binary files: overflows and sizes beyond the end of the file.
WORDS = (0, 1, 0xFF, 0x7FFFFFFF, 0xFFFFFFFF, 0x7FF0000000000000, 0x7FF8000000000001, 0xFFFFFFFFFFFFFFFF, 1 << 40)


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Return the content of a file with one to four random kinds of damage."""
    for _ in range(int(rng.integers(1, 5))):
        kind = int(rng.integers(0, 7))
        damaged = bytearray(data)
        offset = int(rng.integers(0, max(len(data), 1)))
        if kind == 0 and data:
            damaged[offset] ^= 1 << int(rng.integers(0, 8))
        elif kind == 1:
            damaged = damaged[:offset]
        elif kind == 2:
            damaged[offset:offset] = rng.bytes(int(rng.integers(1, 9)))
        elif kind == 3:
            end = offset + int(rng.integers(1, 200))
            damaged[offset:offset] = damaged[offset:end]
        elif kind == 4 and len(data) >= 8:
            width = int(rng.choice([1, 4, 8]))
            value = int(WORDS[int(rng.integers(len(WORDS)))]) & ((1 << 8 * width) - 1)
            damaged[offset : offset + width] = value.to_bytes(width, "little")
        else:
            words = list(_WORD.finditer(data[:200_000]))
            if words:
                match = words[int(rng.integers(len(words)))]
                damaged[match.start() : match.end()] = HOSTILE[int(rng.integers(len(HOSTILE)))]
        data = bytes(damaged)
    return data
