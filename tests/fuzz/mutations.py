"""Damage to a file: bytes flipped, cut, doubled, numbers and words replaced by those that programs trip over."""

from __future__ import annotations

import re

import numpy as np

__all__ = ["mutated"]

#: What stands in place of a number or a word of a text file.
HOSTILE = (
    b"NaN", b"Infinity", b"-1", b"0", b"1e308", b"1e-320", b"9" * 400, b"18446744073709551615", b"-0.0", b"null",
    b"true", b"[]", b"{}", b'""', b"[[[[[[[[]]]]]]]]", b'"\\u0000"', b'"\\ud800"', b'"../../x"', b"\x1b[2J",
    b"\xff\xfe", b"1" * 5000, b"4294967296", b"2147483648", b"1.5", b"\n", b",", b"#",
)  # fmt: skip
_WORD = re.compile(rb'-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?|"[^"\n]{0,40}"|true|false|null|[A-Za-z_]{2,}')
#: Numbers of binary files that overflow, or promise more than there is.
WORDS = (0, 1, 0xFF, 0x7FFFFFFF, 0xFFFFFFFF, 0x7FF0000000000000, 0x7FF8000000000001, 0xFFFFFFFFFFFFFFFF, 1 << 40)


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """The file with one to four kinds of damage."""
    for _ in range(int(rng.integers(1, 5))):
        kind = int(rng.integers(0, 7))
        damaged = bytearray(data)
        place = int(rng.integers(0, max(len(data), 1)))
        if kind == 0 and data:
            damaged[place] ^= 1 << int(rng.integers(0, 8))
        elif kind == 1:
            damaged = damaged[:place]
        elif kind == 2:
            damaged[place:place] = rng.bytes(int(rng.integers(1, 9)))
        elif kind == 3:
            end = place + int(rng.integers(1, 200))
            damaged[place:place] = damaged[place:end]
        elif kind == 4 and len(data) >= 8:
            width = int(rng.choice([1, 4, 8]))
            value = int(WORDS[int(rng.integers(len(WORDS)))]) & ((1 << 8 * width) - 1)
            damaged[place : place + width] = value.to_bytes(width, "little")
        else:
            words = list(_WORD.finditer(data[:200_000]))
            if words:
                match = words[int(rng.integers(len(words)))]
                damaged[match.start() : match.end()] = HOSTILE[int(rng.integers(len(HOSTILE)))]
        data = bytes(damaged)
    return data
