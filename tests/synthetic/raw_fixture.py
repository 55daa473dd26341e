"""Synthetic raw items and sources for tests of the build."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from crawler.imports.declaration import Source
from crawler.items import Kind, RawItem

#: Typical length, width and height in mm of the leaves of `small_taxonomy`.
TYPICAL = {
    "chair": (520, 480, 880),
    "stool": (400, 380, 500),
    "sofa": (2000, 900, 850),
    "desk": (1400, 700, 750),
    "phone": (150, 72, 8),
    "ball": (220, 220, 220),
}

_KINDS: tuple[tuple[str, Kind, bool, bool], ...] = (
    ("shop", "product", False, False),
    ("lab", "measured", True, False),
    ("games", "asset", True, False),
    ("club", "product", False, True),
)
SOURCES = {
    name: Source(
        id=name,
        title=f"The {name}",
        url=f"https://example.org/{name}",
        licence="CC0-1.0" if ship else "none",
        licence_basis="made for the tests",
        attribution="the tests",
        kind=kind,
        ship=ship,
        noncommercial=noncommercial,
        tables=(),
        excluded="made for the tests",
    )
    for name, kind, ship, noncommercial in _KINDS
}


def synthetic_items(per_class: int = 40, seed: int = 0) -> list[RawItem]:
    """Return items of every leaf from four sources, which differ in the names of dimensions and in a size offset."""
    generator = np.random.default_rng(seed)
    offsets = {name: generator.normal(0, 0.08) for name in SOURCES}
    return [
        _item(name, number, np.array(typical) * np.exp(offsets[source] + generator.normal(0, 0.1, 3)), source)
        for name, typical in TYPICAL.items()
        for number, source in zip(range(per_class if name != "stool" else 3), list(SOURCES) * per_class, strict=False)
    ]


def _item(name: str, number: int, sizes: np.ndarray, source: str) -> RawItem:
    first, second, height = (round(float(size), 1) for size in sizes)
    by_source: dict[str, dict[str, float | None]] = {
        "shop": {"width": first, "depth": None if number % 8 == 0 else second, "height": height},
        "lab": {"length": max(first, second), "width": min(first, second), "height": height},
        "club": {"length": max(first, second), "width": min(first, second), "height": height},
        "games": {},
    }
    stated = by_source[source]
    return RawItem(
        source=source,
        source_id=f"{name}-{number}",
        url=f"https://example.org/{source}/{name}-{number}",
        title=f"{name} {number}",
        category_path=("objects", name),
        dimensions_mm=stated,
        extents_mm=None if stated else tuple(sorted((first, second, height), reverse=True)),
        kind=SOURCES[source].kind,
        year=2000 + number % 20,
    )


def written(path: Path, items: list[RawItem]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(item.line() + "\n" for item in items), encoding="utf-8")
    return path
