"""Sources of true sizes: items of a held-out fold, or a small table of typical sizes."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["TYPICAL_MM", "Sizes", "drawn_sizes", "plausible_sizes", "typical_sizes"]

#: Function that draws a size of a category: length, width (at most the length) and height (3,) in mm.
Sizes = Callable[[str, np.random.Generator], FloatArray]

#: Typical length, width and height in mm: round numbers for the layout of rooms, for tests of geometry, and for the
#: detection of wrong rows. No prior is fitted to them.
TYPICAL_MM: dict[str, tuple[float, float, float]] = {
    "alarm clock": (150, 80, 130),
    "armchair": (850, 820, 900),
    "bathtub": (1650, 750, 560),
    "bed": (2080, 1550, 1000),
    "bench": (1500, 550, 850),
    "book": (240, 165, 28),
    "bookcase": (850, 330, 1700),
    "bottle": (80, 80, 260),
    "bowl": (170, 170, 80),
    "bus": (11000, 2550, 3100),
    "cabinet": (900, 450, 900),
    "car": (4450, 1800, 1520),
    "cell phone": (148, 72, 9),
    "chair": (530, 470, 880),
    "coffee table": (1050, 620, 440),
    "couch": (2050, 900, 850),
    "cup": (118, 85, 98),
    "desk": (1350, 680, 750),
    "dining table": (1500, 880, 750),
    "dresser": (1000, 480, 850),
    "floor lamp": (430, 420, 1580),
    "kettle": (230, 170, 240),
    "keyboard": (430, 150, 30),
    "lamp": (300, 290, 470),
    "laptop": (340, 235, 20),
    "microwave": (490, 380, 290),
    "monitor": (560, 210, 450),
    "mouse": (112, 64, 39),
    "nightstand": (480, 400, 550),
    "office chair": (660, 640, 1080),
    "person": (480, 300, 1720),
    "potted plant": (380, 370, 680),
    "printer": (440, 370, 260),
    "refrigerator": (720, 660, 1700),
    "remote": (190, 46, 20),
    "sink": (580, 440, 190),
    "stool": (400, 370, 540),
    "stop sign": (750, 60, 2200),
    "suitcase": (460, 280, 680),
    "teddy bear": (320, 260, 420),
    "toaster": (340, 200, 210),
    "toilet": (700, 390, 760),
    "trash can": (330, 300, 450),
    "truck": (7500, 2400, 3000),
    "tv": (1080, 230, 670),
    "tv stand": (1450, 420, 520),
    "vase": (160, 155, 270),
    "wardrobe": (1300, 590, 2000),
    "washing machine": (620, 590, 860),
}

#: Standard deviations of the log of drawn sizes, common to the axes and per axis; the variation of a class is about
#: 15 %.
_TYPICAL_LOG_SD = (0.12, 0.08)

#: Maximum factor between a plausible size and the typical size on each axis; other rows are errors or toys.
MAX_TYPICAL_FACTOR = 2.5


def typical_sizes(category: str, generator: np.random.Generator) -> FloatArray:
    """Draw a size (3,) in mm close to the typical size."""
    common, per_axis = _TYPICAL_LOG_SD
    shift = common * generator.standard_normal() + per_axis * generator.standard_normal(3)
    return _in_order(np.array(TYPICAL_MM[category]) * np.exp(shift))


def plausible_sizes(category: str, sizes_mm: FloatArray) -> FloatArray:
    """Return the complete rows of sizes (n, 3) that differ from the typical size by less than `MAX_TYPICAL_FACTOR`."""
    complete = sizes_mm[np.all(np.isfinite(sizes_mm) & (sizes_mm > 0), axis=1)]
    ordered = np.array([_in_order(row) for row in complete]).reshape(-1, 3)
    log_ratio = np.abs(np.log(ordered / np.array(TYPICAL_MM[category])))
    return ordered[np.all(log_ratio < np.log(MAX_TYPICAL_FACTOR), axis=1)]


def drawn_sizes(pool: Mapping[str, FloatArray]) -> Sizes:
    """Return a function that draws from the rows of each category ((n, 3) in mm) with equal probabilities.

    Categories without rows have typical sizes.
    """

    def size(category: str, generator: np.random.Generator) -> FloatArray:
        rows = pool.get(category)
        if rows is None:
            return typical_sizes(category, generator)
        return np.asarray(rows[generator.integers(len(rows))])

    return size


def _in_order(size: FloatArray) -> FloatArray:
    """Return the size with the longer horizontal extent first."""
    return np.array([max(size[0], size[1]), min(size[0], size[1]), size[2]])
