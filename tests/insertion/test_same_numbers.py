"""Places, light and look of the shipped scenes have the numbers that they had; see `tests/support/same_numbers.py`.

`python -m tests.insertion.test_same_numbers` writes the file again if a change is intended.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from insertion.composite.camera_look import CameraLookTracker
from insertion.insertion_scene import InsertionScene, open_scene
from insertion.light.environment_estimate import OutdoorLight, environment_at
from insertion.light.environment_map import prefiltered_environment
from insertion.light.lamp_fit import RoomLight
from insertion.light.light_samples import sample_lights
from insertion.placement.at_pixel import placement_at_pixel
from insertion.placement.free_space import free_positions
from insertion.placement.on_category import instances_named, placement_on_category
from insertion.placement.placement import PlacementError, heading
from insertion.request import SceneSource
from insertion.scene.point_cloud import visible_points
from insertion.scene.scale import read_scale
from tests.support.same_numbers import assert_equal_numbers, rounded, write_numbers

SCENES = Path(__file__).resolve().parents[2] / "data" / "scenes"
NUMBERS = Path(__file__).with_name("same_numbers.json")
#: Scale of each scene in metres per unit, which these tests do not estimate.
SCALES = {"demo_room": 0.286, "lund_street": 1.0}


@cache
def opened(name: str) -> InsertionScene:
    return open_scene(SceneSource(folder=SCENES / name, scale=read_scale(SCENES / name, SCALES[name])))


def place_numbers(name: str) -> dict[str, list[float]]:
    """Support surfaces, free positions, positions at a grid of pixels and on objects."""
    scene = opened(name)
    space, numbers = scene.space, {}
    for number, surface in enumerate(space.supports.surfaces):
        numbers[f"surface {number}"] = [surface.plane.height, surface.plane.sigma, float(surface.plane.cells.sum())]
    for metres in (0.08, 0.3):
        found = free_positions(space, metres / space.metres_per_unit, 2 * metres / space.metres_per_unit)
        numbers[f"free {metres}"] = [value for place in found for value in place.position]
        if found and name == "demo_room":  # the street has no wall
            numbers[f"wall {metres}"] = [*np.ravel(heading(found[0], "wall", space.cloud)[0])]
    view = space.views[2]
    for x in np.linspace(0.05, 0.95, 7) * view.camera.width:
        for y in np.linspace(0.3, 0.95, 5) * view.camera.height:
            try:
                place = placement_at_pixel(space, view, float(x), float(y), 0.1 / space.metres_per_unit)
                numbers[f"pixel {x:.0f} {y:.0f}"] = [*place.position, -1 if place.plane is None else place.plane]
            except PlacementError as error:
                numbers[f"pixel {x:.0f} {y:.0f}"] = [float(len(str(error).split("(")[0]))]
    for category in sorted({item.category for item in space.instances}):
        masks = instances_named(space.instances, category)
        try:
            place = placement_on_category(space, category, masks, 0.05 / space.metres_per_unit, 0.1)
            numbers[f"on {category}"] = [*place.position]
        except PlacementError:
            numbers[f"on {category}"] = []
    return {key: rounded(row) for key, row in numbers.items()}


def light_numbers(name: str) -> dict[str, list[float]]:
    """Lamps or sun, and the environment of an object."""
    scene = opened(name)
    source, cloud = scene.light.source, scene.space.cloud
    numbers: dict[str, list[float]] = {}
    if isinstance(source, RoomLight):
        numbers["room"] = [source.unseen]
        for number, lamp in enumerate(source.lamps):
            mean = lamp.weights @ lamp.positions
            strength = float(lamp.weights @ lamp.strengths)
            numbers[f"lamp {number}"] = [*mean, *lamp.colour, lamp.size, strength, len(lamp.weights)]
    elif isinstance(source, OutdoorLight):
        numbers["sun"] = [0.0] if source.sun is None else [*source.sun]
    basis = scene.space.supports.basis
    ground = scene.space.supports.ground(cloud)
    assert ground is not None
    foot = np.median(cloud.points, axis=0)
    foot += (ground.plane.height - basis[2] @ foot) * basis[2]
    environment = environment_at(foot, 0.4 / scene.space.metres_per_unit, basis, cloud, scene.images, source)
    rows = environment.radiance.reshape(8, -1, 3).mean(axis=(1, 2))
    numbers["map"] = [*rows, float(environment.coverage.mean()), *environment.irradiance(basis[2])]
    lights = sample_lights(environment, 4)
    numbers["lights"] = [len(lights.directions), *np.abs(lights.directions).mean(axis=0)]
    numbers["rough"] = [float(level.std()) for level in prefiltered_environment(environment)]
    return {key: rounded(row) for key, row in numbers.items()}


def look_numbers(name: str) -> dict[str, list[float]]:
    """Gain, blur and grain of two frames, and masks of a frame that has none of its own."""
    scene = opened(name)
    tracker, numbers = CameraLookTracker(smooth=True), {}
    for row in scene.images.rows[:2]:
        view = scene.scene.views[row]
        points = visible_points(view, scene.space.cloud, row)
        look = tracker.next(scene.images.image(row), points, scene.space.cloud)
        numbers[f"look {row}"] = [*look.gain, *look.blur.ravel(), *look.grain.mean(axis=0), look.grain_px, look.common]
    return {key: rounded(row) for key, row in numbers.items()}


PARTS = {"places": place_numbers, "light": light_numbers, "look": look_numbers}


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("name", SCALES)
def test_places_light_and_look_have_the_numbers_that_they_had(name: str, part: str) -> None:
    assert_equal_numbers(PARTS[part](name), json.loads(NUMBERS.read_text())[f"{name}, {part}"])


if __name__ == "__main__":
    write_numbers(NUMBERS, {f"{name}, {part}": PARTS[part](name) for name in SCALES for part in PARTS})
