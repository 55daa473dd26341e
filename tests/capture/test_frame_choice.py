"""Which frames are chosen: evenly along the motion, the sharpest of each stretch."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.sources.frame_selection import DEFAULT_FRAMES, MAX_FRAMES, Motion, chosen_frames, motion_of


def _motion(step: list[float], sharpness: list[float] | None = None) -> Motion:
    n = len(step)
    sharp = np.ones(n) if sharpness is None else np.array(sharpness)
    return Motion(np.arange(n) / 30, np.array([0.0, *step[1:]]), sharp)


@given(st.lists(st.floats(0, 0.3), min_size=2, max_size=400), st.integers(2, 60))
def test_frames_ascend_and_are_no_more_than_wanted(steps: list[float], wanted: int) -> None:
    chosen = chosen_frames(_motion(steps), wanted)
    assert (np.diff(chosen) > 0).all()
    assert 1 <= len(chosen) <= wanted
    assert chosen[0] >= 0
    assert chosen[-1] < len(steps)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=800))
def test_the_default_is_bounded(steps: list[float]) -> None:
    assert len(chosen_frames(_motion(steps))) <= MAX_FRAMES


def test_a_pause_costs_few_frames() -> None:
    steps = [0.02] * 100 + [0.0] * 100 + [0.02] * 100
    chosen = chosen_frames(_motion(steps), 40)
    assert len(chosen) > 35
    assert ((chosen >= 102) & (chosen < 198)).sum() <= 2


def test_the_sharpest_of_a_stretch_is_taken() -> None:
    sharpness = [0.1] * 60
    for k in (3, 17, 31, 52):
        sharpness[k] = 0.5
    assert chosen_frames(_motion([0.05] * 60, sharpness), 4).tolist() == [3, 17, 31, 52]


def test_more_frames_only_where_the_picture_races() -> None:
    slow, fast = _motion([0.02] * 3000), _motion([0.1] * 3000)
    assert len(chosen_frames(slow)) == 240  # a quarter of the width each
    assert len(chosen_frames(fast)) > DEFAULT_FRAMES


@pytest.mark.parametrize(
    ("motion", "count"),
    [(0.0, 12), (0.167, 12), (0.183, 13), (0.695, 49), (0.72, 50), (12.4, 50), (12.7, 51), (74.9, 300), (90.0, 300)],
)
def test_the_number_of_frames_follows_the_motion(motion: float, count: int) -> None:
    """At least 12, one per 0.014 of the longer side up to 50, then one per quarter up to 300."""
    assert len(chosen_frames(_motion([motion / 3999] * 4000))) == count


def test_motion_is_measured_in_shares_of_the_longer_side() -> None:
    generator = np.random.default_rng(1)
    import cv2

    grain = cv2.GaussianBlur(generator.integers(0, 255, (240, 520, 3), dtype=np.uint8), (0, 0), 2)
    wide = np.asarray(cv2.normalize(grain, None, 0, 255, cv2.NORM_MINMAX))
    frames = [(k / 30, np.ascontiguousarray(wide[:, 8 * k : 8 * k + 320])) for k in range(10)]
    motion = motion_of(frames)
    np.testing.assert_allclose(motion.step[1:], 8 / 320, atol=0.002)
    blurred = motion_of([(0.0, cv2.GaussianBlur(frames[0][1], (0, 0), 4)), (0.1, frames[0][1])])
    assert blurred.sharpness[0] < 0.5 * blurred.sharpness[1]


def test_a_plain_picture_has_no_motion_to_measure() -> None:
    plain = np.full((100, 100, 3), 90, dtype=np.uint8)
    motion = motion_of([(0.0, plain), (0.1, plain)])
    assert motion.step[1] == pytest.approx(0.25)
