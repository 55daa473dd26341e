"""Lamps from the shading of planes: rooms of plain cells under a known light."""

from __future__ import annotations

import numpy as np
import pytest

from insertion.light.environment_estimate import raise_ceiling
from insertion.light.environment_map import HEIGHT, WIDTH, Environment, SphereLights, map_directions, solid_angles
from insertion.light.lamp_fit import RoomLight, fit_room_light
from insertion.light.light_samples import sample_lights
from insertion.scene.plane_cells import PlaneCells
from metric_base.arrays import FloatArray

# Published values, written out so that a changed rule fails a test.
WHITE_ALBEDO = 0.65

UP = np.array([0.0, 0.0, 1.0])
#: Floor 5 x 4 m, walls 2.5 m high: middle, half sides, normal, albedo of each plane.
PLANES = (
    ((0, 0, 0), (2.5, 2.0, 0), (0, 0, 1), 0.3),
    ((0, 2.0, 1.25), (2.5, 0, 1.25), (0, -1, 0), 0.55),
    ((-2.5, 0, 1.25), (0, 2.0, 1.25), (1, 0, 0), 0.55),
    ((2.5, 0, 1.25), (0, 2.0, 1.25), (-1, 0, 0), 0.5),
)


def _room(lamp: tuple[float, float, float] | None, strength: float, seed: int = 0) -> PlaneCells:
    """Cells lit by an ambient irradiance of 1 and one lamp that shines down, with a tenth of noise."""
    generator = np.random.default_rng(seed)
    places, normals, light, plane = [], [], [], []
    for number, (middle, half, normal, albedo) in enumerate(PLANES):
        at = np.array(middle) + generator.uniform(-1, 1, (60, 3)) * half
        irradiance = np.ones(60)
        if lamp is not None:
            away = np.array(lamp) - at
            distance = np.linalg.norm(away, axis=1)
            shone = np.maximum(away[:, 2], 0) / distance
            irradiance += strength * shone * np.maximum(away @ np.array(normal, dtype=float), 0) / distance**3
        places.append(at)
        normals.append(np.tile(np.array(normal, dtype=float), (60, 1)))
        light.append(np.log(albedo / np.pi * irradiance) + generator.normal(0, 0.1, 60))
        plane.append(np.full(60, number))
    diagonal = float(np.linalg.norm([5.0, 4.0, 2.5]))
    return PlaneCells(
        np.concatenate(places), np.concatenate(normals), np.concatenate(light), np.concatenate(plane), diagonal
    )


#: Of a lamp in such a room, as the energy of a closed room has it: about 16 times the ambient light a third of a
#: diagonal away.
STRENGTH = 70.0


def _down_at(shading: RoomLight, place: FloatArray) -> float:
    """Irradiance of the floor by the lamps at a place (3,)."""
    total = 0.0
    for lamp in shading.lamps:
        away = lamp.positions - place
        far = np.linalg.norm(away, axis=1)
        shone = np.where(lamp.facing.any(axis=1), np.maximum(-(away * lamp.facing).sum(axis=1) / far, 0), 1)
        total += float(lamp.weights @ (lamp.strengths * shone * away[:, 2] / far**3))
    return total


def _lamp_place(shading: RoomLight) -> FloatArray:
    return np.asarray(shading.lamps[0].weights @ shading.lamps[0].positions)


@pytest.mark.parametrize("lamp", [(1.0, -0.8, 2.4), (-1.2, 0.9, 2.3)])
def test_the_shading_of_planes_determines_the_position_of_a_lamp(lamp: tuple[float, float, float]) -> None:
    shading = fit_room_light(_room(lamp, STRENGTH), UP)
    assert shading is not None
    assert len(shading.lamps) == 1
    assert np.linalg.norm(_lamp_place(shading) - lamp) < 0.7
    assert _down_at(shading, np.array([lamp[0], lamp[1], 0.0])) == pytest.approx(STRENGTH / lamp[2] ** 2, rel=0.35)


def test_constant_light_has_a_weak_lamp() -> None:
    shading = fit_room_light(_room(None, 0.0), UP)
    assert shading is not None
    assert _down_at(shading, np.zeros(3)) < 0.35 * np.pi * shading.unseen


def test_no_lamp_is_at_a_visibly_free_position() -> None:
    true = (1.0, -0.8, 2.4)
    shading = fit_room_light(_room(true, STRENGTH), UP, lambda places: places[:, 0] > 0)
    assert shading is not None
    spacing = 1.3 * 5.0 / 10
    assert all((lamp.positions[:, 0] <= spacing / 2).all() for lamp in shading.lamps)


@pytest.mark.parametrize(
    ("rows", "is_fitted"), [(range(60), False), (range(30, 89), False), (range(30, 90), True), (range(20), False)]
)
def test_a_fit_needs_60_cells_on_2_planes(rows: range, is_fitted: bool) -> None:
    room, some = _room(None, 0.0), slice(rows.start, rows.stop)
    cells = PlaneCells(
        room.positions[some], room.normals[some], room.log_luminance[some], room.plane[some], room.diagonal
    )
    assert (fit_room_light(cells, UP) is not None) == is_fitted


def test_the_irradiance_of_a_lamp_decreases_with_distance() -> None:
    """Its points send power / r^2 to every place, from where it is; the rest sends the same to all."""
    rest = np.full((HEIGHT, WIDTH, 3), 0.1, np.float32)
    place, power = np.array([0.0, 1.0, 2.0]), np.array([3.0, 2.0, 1.0])
    lamps = SphereLights(place[None], power[None], np.array([0.02]), np.zeros(3))
    lights = sample_lights(Environment(rest, np.eye(3), rest[..., 0], rest, lamps), 5)
    assert lights.power[lights.near == 0].sum(axis=0) == pytest.approx(np.full(3, 0.4 * np.pi), rel=1e-3)
    for offset in (np.zeros(3), np.array([0.5, 0.0, 0.5]), np.array([-1.0, 0.3, 0.0])):
        moved = lights.seen_from(offset, 0.1)
        points, away = moved.subset(moved.near > 0), place - offset
        assert points.power.sum(axis=0) == pytest.approx(power / (away @ away), rel=0.02)
        assert (points.directions @ away / np.linalg.norm(away)).min() > 0.999


def test_unseen_light_makes_a_white_surface_white() -> None:
    """Its irradiance is the sum of the lamp's lobe and the remainder."""
    filled = np.full((HEIGHT, WIDTH, 3), 0.1)
    seen = np.zeros((HEIGHT, WIDTH))
    raised = raise_ceiling(filled, seen, 0.12, np.array([0.0, 0.0, 1.0]))
    weight = np.maximum(map_directions()[..., 2], 0) * solid_angles()[:, None]
    irradiance = float((weight * raised[..., 0]).sum())
    assert irradiance == pytest.approx(np.pi * 0.12 / WHITE_ALBEDO, rel=1e-6)
