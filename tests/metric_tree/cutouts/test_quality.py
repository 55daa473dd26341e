"""Both sides of the thresholds of the assessment of a mask."""

from __future__ import annotations

import numpy as np
import pytest

from metric_tree.cutouts.quality import assessment

SIDE = 200


def _reason(*boxes: tuple[int, int, int, int], alpha: int = 255) -> str | None:
    """Assess boxes (rows from and to, columns from and to) with an opacity, black on white."""
    mask = np.zeros((SIDE, SIDE), dtype=bool)
    for top, bottom, left, right in boxes:
        mask[top:bottom, left:right] = True
    picture = np.where(mask[..., None], 0, 255).astype(np.uint8).repeat(3, axis=2)
    return assessment(picture, np.where(mask, alpha, 0).astype(np.uint8)).reason


@pytest.mark.parametrize(("alpha", "reason"), [(127, "empty"), (224, None)])
def test_the_foreground_is_opaque_from_half_the_range(alpha: int, reason: str | None) -> None:
    assert _reason((50, 150, 50, 150), alpha=alpha) == reason


@pytest.mark.parametrize(("alpha", "reason"), [(128, "doubtful"), (223, "doubtful"), (224, None)])
def test_opacities_from_32_to_224_are_undecided(alpha: int, reason: str | None) -> None:
    assert _reason((50, 150, 50, 150), alpha=alpha) == reason


@pytest.mark.parametrize(
    ("boxes", "reason"),
    [
        ([(50, 60, 50, 69)], "empty"),  # 190 of 40,000 pixels: MIN_FOREGROUND_FRACTION of 0.005
        ([(50, 60, 50, 71)], None),
        ([(0, 150, 0, 100)], None),  # a third of the border: MAX_BORDER_FRACTION of 0.6
        ([(0, 100, 0, 200)], None),  # a half
        ([(0, 150, 0, 200)], "full"),  # five eighths
        ([(20, 120, 20, 120), (130, 190, 130, 186)], None),  # 3,360 to 10,000: MIN_SECOND_FRACTION of 0.35
        ([(20, 120, 20, 120), (130, 190, 130, 190)], "several"),
    ],
)
def test_both_sides_of_the_areas_of_a_mask(boxes: list[tuple[int, int, int, int]], reason: str | None) -> None:
    assert _reason(*boxes) == reason


@pytest.mark.parametrize(("margin", "reason"), [(2, None), (1, "full")])
def test_a_foreground_of_97_percent_is_full(margin: int, reason: str | None) -> None:
    """(196 / 200)^2 = 0.960 and (198 / 200)^2 = 0.980 of the image; the object does not touch the border."""
    assert _reason((margin, SIDE - margin, margin, SIDE - margin)) == reason


@pytest.mark.parametrize(("undecided", "reason"), [(49, None), (51, "doubtful")])
def test_a_quality_of_one_half_is_enough(undecided: int, reason: str | None) -> None:
    """The edge has full contrast, so the quality is the fraction of decided opacities."""
    alpha = np.zeros((SIDE, SIDE), dtype=np.uint8)
    alpha[50:150, 50:150] = 255
    alpha[50 : 50 + undecided, 50:150] = 200
    picture = np.where(alpha[..., None] > 0, 0, 255).astype(np.uint8).repeat(3, axis=2)
    assert assessment(picture, alpha).reason == reason


@pytest.mark.parametrize(("rim", "reason"), [(2, None), (3, "doubtful")])
def test_the_colours_of_three_pixels_on_both_sides_of_the_edge_are_compared(rim: int, reason: str | None) -> None:
    """The mask has a rim in the colour of the background."""
    alpha = np.zeros((SIDE, SIDE), dtype=np.uint8)
    alpha[50:150, 50:150] = 255
    picture = np.full((SIDE, SIDE, 3), 255, dtype=np.uint8)
    picture[50 + rim : 150 - rim, 50 + rim : 150 - rim] = 0
    assert assessment(picture, alpha).reason == reason
