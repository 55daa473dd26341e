"""Cut-outs of drawn product images have the areas and qualities that they had; see `tests/support/same_numbers.py`.

`python -m tests.metric_tree.cutouts.test_same_cutouts` writes the file again if a change is intended.
"""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_tree.cutouts.plain import Plain
from metric_tree.cutouts.quality import assessment
from tests.support.same_numbers import assert_equal_numbers, rounded, write_numbers

NUMBERS = Path(__file__).with_name("same_cutouts.json")


def drawn(case: int) -> NDArray[np.uint8]:
    """An object with a hole, on a background with noise, a gradient and a shadow that grow with the case."""
    generator = np.random.default_rng(case)
    rows, columns = np.mgrid[:200, :240]
    grey = 245 - 0.02 * case * columns - 0.00008 * case * (rows - 100.0) ** 2
    image = np.repeat(grey[..., None], 3, axis=2)
    shadow = cv2.GaussianBlur(cv2.ellipse(np.zeros((200, 240)), (130, 160), (70, 14), 0, 0, 360, 1.0, -1), (0, 0), 5)
    image *= 1 - (0.1 + 0.04 * case) * shadow[..., None]
    shape = np.zeros((200, 240), np.uint8)
    cv2.rectangle(shape, (70, 50), (170, 160), 1, -1)
    cv2.circle(shape, (120, 100), 3 + 2 * case, 0, -1)
    cv2.circle(shape, (30, 30), case, 1, -1)
    colour = generator.uniform(60, 225, 3) if case % 2 else np.array([212.0, 216.0, 222.0]) - 2 * case
    image = np.where(shape[..., None] > 0, colour + 12 * np.sin(columns / 3)[..., None], image)
    image += generator.normal(0, 0.45 * case, image.shape)
    return np.asarray(np.clip(np.rint(image), 0, 255), dtype=np.uint8)


def cutout_numbers() -> dict[str, list[float]]:
    numbers = {}
    for case in range(9):
        image = drawn(case)
        found = Plain().foreground(image)
        assessed = assessment(image, found.alpha)
        alpha = found.alpha.astype(float) / 255
        half = [alpha[:, :120].sum(), alpha[:, 120:].sum(), (alpha * (1 - alpha)).sum()]
        box = assessed.box or ()
        numbers[f"{case} {found.refused or assessed.reason}"] = rounded([*half, *box, assessed.share, assessed.quality])
    return numbers


def test_cutouts_have_the_areas_and_qualities_that_they_had() -> None:
    assert_equal_numbers(cutout_numbers(), json.loads(NUMBERS.read_text())["plain"])


if __name__ == "__main__":
    write_numbers(NUMBERS, {"plain": cutout_numbers()})
