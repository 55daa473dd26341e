"""One scene written in other ways has one answer: other units, another world frame, other orders, points twice."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from estimator import Instance, ScaleResult, Scene, estimate_scale, read_instances, read_scene
from tests.synthetic.same_scene import annotated_twice, moved_scene, points_twice, shuffled

DEMO = Path(__file__).resolve().parents[2] / "data" / "scenes" / "demo_room"
#: Maximum change of the scale; a turn of the world changes the grid of the search for the floor, and twice the points
#: change the footprints a little, and both change the scale more.
MOVED, TURNED = 0.005, 0.01
SEEDS = st.integers(0, 2**32 - 1)


@cache
def demo() -> tuple[Scene, tuple[Instance, ...], ScaleResult]:
    """The demo room as it ships, and its answer."""
    scene = read_scene(DEMO)
    instances = tuple(read_instances(DEMO / "instances.json", scene))
    return scene, instances, estimate_scale(scene, instances)


def assert_same_answer(result: ScaleResult, factor: float, most: float) -> None:
    """The answer, its interval and its standing are those of the demo, scaled."""
    _, _, whole = demo()
    assert whole.scale is not None
    assert whole.interval is not None
    assert result.scale is not None
    assert result.interval is not None
    assert result.scale * factor == pytest.approx(whole.scale, rel=most)
    assert result.interval.low * factor == pytest.approx(whole.interval.low, rel=2 * most)
    assert result.interval.high * factor == pytest.approx(whole.interval.high, rel=2 * most)
    assert result.status == whole.status
    assert len(result.objects) == len(whole.objects)
    assert sum(bool(one.used) for one in result.objects) == sum(bool(one.used) for one in whole.objects)


@settings(max_examples=4)
@example(exponent=-9.0, seed=0)
@example(exponent=9.0, seed=1)
@given(exponent=st.floats(-9, 9), seed=SEEDS)
def test_units_axes_and_origin_of_the_world_are_free(exponent: float, seed: int) -> None:
    scene, instances, _ = demo()
    generator = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=generator).as_matrix()
    shift = generator.normal(0, 3, 3)
    factor = 10.0**exponent
    assert_same_answer(estimate_scale(moved_scene(scene, factor, rotation, shift), instances), factor, TURNED)


@settings(max_examples=2)
@given(exponent=st.floats(-9, 9))
def test_the_unit_alone_moves_the_answer_less(exponent: float) -> None:
    scene, instances, _ = demo()
    moved = moved_scene(scene, 10.0**exponent, np.eye(3), np.zeros(3))
    assert_same_answer(estimate_scale(moved, instances), 10.0**exponent, MOVED)


@settings(max_examples=3)
@given(seed=SEEDS)
def test_orders_say_nothing(seed: int) -> None:
    scene, instances, _ = demo()
    assert_same_answer(estimate_scale(*shuffled(scene, instances, seed)), 1.0, MOVED)


def test_points_that_are_there_twice_say_no_more() -> None:
    scene, instances, _ = demo()
    assert_same_answer(estimate_scale(points_twice(scene), instances), 1.0, TURNED)


def test_annotations_that_are_there_twice_say_no_more() -> None:
    scene, instances, _ = demo()
    assert_same_answer(estimate_scale(scene, annotated_twice(instances)), 1.0, MOVED)
