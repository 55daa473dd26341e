"""Comparison of results with stored numbers, for tests that show which results a changed rule or weight moves."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

__all__ = ["assert_equal_numbers", "rounded", "write_numbers"]

Numbers = Mapping[str, list[float]]


def rounded(values: Iterable[float]) -> list[float]:
    """Return the values with five significant digits, as they are stored."""
    return [float(f"{float(value):.5g}") for value in values]


def assert_equal_numbers(now: Numbers, before: Numbers) -> None:
    """Compare with a relative tolerance of 0.2 %: less than a changed rule moves, more than other libraries do."""
    assert now.keys() == before.keys()
    for key, row in before.items():
        np.testing.assert_allclose(now[key], row, rtol=2e-3, atol=2e-5, err_msg=key)


def write_numbers(file: Path, found: Mapping[str, Numbers]) -> None:
    """Write the numbers, one list per line."""
    groups = [
        f"{json.dumps(name)}: {{\n"
        + ",\n".join(f"{json.dumps(key)}: {json.dumps(row)}" for key, row in rows.items())
        + "}"
        for name, rows in found.items()
    ]
    file.write_text("{" + ",\n".join(groups) + "}\n", encoding="utf-8")
