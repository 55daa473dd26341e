"""Maps of light and the lights that replace them: energies, directions and distances by formula."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.records.scene import Camera, Scene, View
from insertion.colour import luminance
from insertion.footage.footage import SceneImages
from insertion.light import environment_estimate as estimate
from insertion.light.direction_samples import DirectionSamples, average_by_direction, mirror_detail, with_support
from insertion.light.environment_map import (
    HEIGHT,
    LEVELS,
    WIDTH,
    Environment,
    SphereLights,
    ggx_lobe,
    map_directions,
    prefiltered_environment,
    solid_angles,
)
from insertion.light.lamp_fit import Lamp, RoomLight
from insertion.light.light_samples import (
    LightSamples,
    divide_box,
    median_cut,
    sample_lamps,
    sample_lights,
)
from insertion.scene.occupancy import Occupancy
from insertion.scene.point_cloud import ColouredPoints

# Published values, written out so that a changed rule fails a test.
LAMP_EXPONENT = 12
LAMP_FRACTION = 0.6
LAMP_SIGMA = 0.35
MIN_DISTANCE_RADII = 2.0

#: Axes of a map that is turned against the scene: its up is the scene's +y.
TURNED = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
SEEN = np.ones((HEIGHT, WIDTH), np.float32)


def _even(level: float = 1.0) -> Environment:
    return Environment(np.full((HEIGHT, WIDTH, 3), level, np.float32), TURNED, SEEN)


def _one_cell(row: int, column: int, level: float = 50.0) -> Environment:
    radiance = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    radiance[row, column] = level
    return Environment(radiance, TURNED, SEEN)


def test_rows_of_a_map_are_elevations_and_columns_azimuths() -> None:
    directions = map_directions(2, 4)
    half = np.sqrt(0.5)
    assert directions[:, 0] == pytest.approx(np.array([[-0.5, -0.5, half], [-0.5, -0.5, -half]]))
    assert directions[0, 1:] == pytest.approx(np.array([[0.5, -0.5, half], [0.5, 0.5, half], [-0.5, 0.5, half]]))
    assert 4 * solid_angles(2, 4) == pytest.approx([2 * np.pi] * 2)
    angles = solid_angles()
    assert WIDTH * angles.sum() == pytest.approx(4 * np.pi)
    assert angles[0] == pytest.approx(2 * np.pi / WIDTH * (1 - np.cos(np.pi / HEIGHT)))
    assert np.linalg.norm(map_directions(), axis=-1) == pytest.approx(1)


def test_constant_radiance_has_pi_times_its_irradiance() -> None:
    for normal in np.array([[0, 1.0, 0], [0, -1.0, 0], [0.6, 0, 0.8]]):
        assert _even(0.7).irradiance(normal) == pytest.approx(np.full(3, 0.7 * np.pi), rel=2e-3)


def test_the_irradiance_of_one_cell_has_the_cosine() -> None:
    environment = _one_cell(20, 70)
    toward = map_directions()[20, 70] @ TURNED  # in the scene
    for normal in (toward, np.array([0.0, 1.0, 0.0]), -toward):
        cosine = max(float(normal @ toward), 0.0)
        assert environment.irradiance(normal) == pytest.approx(np.full(3, 50 * cosine * solid_angles()[20]), rel=1e-6)


def test_each_level_of_reflections_has_half_the_size_and_more_blur() -> None:
    levels = prefiltered_environment(_one_cell(20, 70))
    assert [level.shape for level in levels] == [(4 * HEIGHT >> k, 4 * WIDTH >> k, 3) for k in range(LEVELS + 1)]
    peaks = [float(level.max() / level.mean()) for level in levels]
    assert sorted(peaks, reverse=True) == peaks
    assert peaks[1] > 2 * peaks[-1]
    means = [float(np.average(level.mean(axis=(1, 2)), weights=solid_angles(*level.shape[:2]))) for level in levels]
    assert means == pytest.approx([means[0]] * (LEVELS + 1), rel=0.1)  # no lobe adds or loses light


def test_mirrors_show_samples_that_are_finer_than_a_cell_of_the_map() -> None:
    """Stripes of half a cell vanish in the map of 128 x 64 cells, but not in the reflection."""
    directions = map_directions(4 * HEIGHT, 4 * WIDTH)
    stripes = np.where(np.arange(4 * WIDTH) % 4 < 2, 0.2, 0.8)[None, :, None] * np.ones((4 * HEIGHT, 1, 3))
    samples = DirectionSamples(
        directions.reshape(-1, 3), np.float32(stripes.reshape(-1, 3)), np.zeros(directions[..., 0].size, bool)
    )
    radiance = average_by_direction(samples)[0]
    assert radiance == pytest.approx(np.full(radiance.shape, 0.5), abs=1e-6)
    detail = mirror_detail(samples, radiance)
    environment = Environment(np.float32(radiance), np.eye(3), np.ones((HEIGHT, WIDTH), np.float32), detail=detail)
    row = prefiltered_environment(environment)[0][2 * HEIGHT, :, 0]
    assert row.max() > 2 * row.min()


def test_the_lobe_of_reflections_is_ggx_of_half_the_angle() -> None:
    alpha2 = 0.5**4
    assert ggx_lobe(np.array(1.0), 0.5) == pytest.approx(1 / alpha2)
    assert ggx_lobe(np.array(0.5), 0.5) == pytest.approx(alpha2 / (0.75 * (alpha2 - 1) + 1) ** 2 * 0.5)
    assert ggx_lobe(np.array(-0.5), 0.5) == 0
    assert ggx_lobe(np.array(1.0), 0.01) == ggx_lobe(np.array(1.0), 0.05)


def test_light_samples_keep_energy_and_mean_direction_of_the_map() -> None:
    environment = _even(0.25)
    lights = median_cut(environment, environment.radiance, 5)
    assert lights.power.sum(axis=0) == pytest.approx(np.full(3, np.pi), rel=1e-6)
    assert lights.angle.sum() == pytest.approx(4 * np.pi)
    assert len(lights.near) == 32
    assert not lights.near.any()
    assert (lights.angle > 0.2).all()  # parts of even light are about as large as each other: 0.39 on average
    assert (lights.angle < 0.7).all()
    for normal in np.eye(3):
        lit = np.maximum(lights.directions @ normal, 0) @ lights.power
        assert lit == pytest.approx(environment.irradiance(normal), rel=0.05)


def test_a_bright_spot_has_a_separate_light_sample() -> None:
    environment = _one_cell(20, 70)
    lights = sample_lights(environment, 6)
    best = int(lights.power[:, 0].argmax())
    assert lights.power[best] == pytest.approx(np.full(3, 50 * solid_angles()[20]), rel=1e-6)
    assert lights.directions[best] @ (map_directions()[20, 70] @ TURNED) > 0.97
    assert lights.angle[best] < 0.1 * 4 * np.pi / 2**6


def test_median_cut_halves_the_energy() -> None:
    for sums, cut in (([1, 1, 1, 1], 2), ([4, 1, 1], 1), ([1, 1, 4], 2), ([0, 0], 1)):
        row = np.array(sums, dtype=float)[None]
        assert divide_box(row, (0, 1, 0, len(sums))) == [(0, 1, 0, cut), (0, 1, cut, len(sums))]
    bright = np.ones((8, 16))
    assert divide_box(bright, (2, 6, 0, 16)) == [(2, 6, 0, 8), (2, 6, 8, 16)]
    assert divide_box(bright, (0, 8, 3, 5)) == [(0, 4, 3, 5), (4, 8, 3, 5)]
    assert divide_box(bright, (0, 1, 0, 4)) == [(0, 1, 0, 2), (0, 1, 2, 4)]
    assert divide_box(bright, (3, 4, 5, 6)) == [(3, 4, 5, 6)]
    assert divide_box(bright, (3, 5, 5, 6)) == [(3, 4, 5, 6), (4, 5, 5, 6)]


def test_near_lights_are_seen_from_another_position() -> None:
    """A lamp 2 m above, and the sun: one comes closer and changes its way, the other does not."""
    up, sun = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8])
    lights = LightSamples(
        np.array([up, sun]), np.array([[3.0] * 3, [1.0] * 3]), np.array([0.5, 0.0]), np.array([0.0, 0.1])
    )
    side = lights.seen_from(np.array([1.5, 0.0, 0.0]), 0.1)
    assert side.directions == pytest.approx(np.array([[-0.6, 0.0, 0.8], sun]))
    assert side.power[:, 0] == pytest.approx([3.0 * 2**2 / 2.5**2, 1.0])
    assert side.near == pytest.approx([1 / 2.5, 0.0])
    large = lights.seen_from(np.zeros(3), 2.0)
    assert large.near == pytest.approx([1 / (MIN_DISTANCE_RADII * 2.0), 0.0])
    assert lights.scaled(0.1).near == pytest.approx([0.05, 0.0])
    assert lights.above_horizon(np.array([1.0, 0.0, 0.0])).angle.tolist() == [0.1]
    assert lights.subset(np.array([True, False])).angle.tolist() == [0.0]


def test_a_lamp_is_sampled_over_its_disc() -> None:
    lamp = SphereLights(
        np.array([[0.0, 0, 3.0]]), np.array([[2.0, 1.0, 0.5]]), np.array([0.5]), np.array([0.0, 0, 1.0])
    )
    points = sample_lamps(lamp, 512)
    places = points.directions / points.near[:, None] + lamp.centre
    assert places.mean(axis=0) == pytest.approx([0, 0, 3.0], abs=0.02)
    assert places.std(axis=0) == pytest.approx(np.full(3, LAMP_SIGMA * 0.5), rel=0.05)
    assert points.power.sum(axis=0) == pytest.approx(np.array([2.0, 1.0, 0.5]) / 2**2, rel=1e-6)
    assert not points.angle.any()
    inside = SphereLights(np.array([[0.0, 0, 0.01]]), np.ones((1, 3)), np.array([0.5]), np.zeros(3))
    assert (1 / sample_lamps(inside, 64).near).min() >= 0.25  # not closer than its radius
    two = SphereLights(
        np.array([[0.0, 0, 1.0], [0.0, 0, -2.0]]), np.full((2, 3), 3.0), np.array([0.01, 0.01]), np.zeros(3)
    )
    below = sample_lamps(two, 100).directions[:, 2] < 0
    assert np.count_nonzero(below) == 20  # 3 / 4 against 3


def test_a_lamp_has_the_cosine_to_its_axis_and_its_colour() -> None:
    places = np.array([[0.0, 0.0, 2.0], [2.0, 0.0, 2.0]])
    down = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1.0]])
    lamp = Lamp(places, down, np.array([0.25, 0.75]), np.array([4.0, 8.0]), 0.3, np.array([1.0, 0.5, 2.0]))
    bulb = Lamp(places[:1], np.zeros((1, 3)), np.ones(1), np.array([5.0]), 0.2)
    up = Lamp(places[:1], -down[:1], np.ones(1), np.array([5.0]), 0.2)
    spots = estimate.lamp_spheres([lamp, bulb, up], np.zeros(3))
    assert spots.power == pytest.approx(
        np.array([[1.0, 0.5, 2.0], np.array([1.0, 0.5, 2.0]) * 6 * np.sqrt(0.5), [5.0] * 3, [0.0] * 3])
    )
    assert spots.size.tolist() == [0.3, 0.3, 0.2, 0.2]
    assert spots.positions == pytest.approx(np.concatenate([places, places[:1], places[:1]]))


def test_lamps_add_their_irradiance_to_the_rest() -> None:
    rest, middle = np.full((HEIGHT, WIDTH, 3), 0.2), np.array([1.0, 2.0, 3.0])
    lamps = SphereLights(middle + 2.0 * TURNED[2:], np.array([[8.0, 4.0, 2.0]]), np.array([0.2]), middle)
    lit = estimate.add_lamps(rest, SEEN, TURNED, lamps)
    assert lit.ambient == pytest.approx(0.2)
    added = lit.irradiance(TURNED[2]) - 0.2 * np.pi
    assert added == pytest.approx([2.0, 1.0, 0.5], rel=0.03)
    assert lit.irradiance(-TURNED[2]) == pytest.approx(np.full(3, 0.2 * np.pi), rel=0.01)
    near = SphereLights(middle[None] + 0.01, np.ones((1, 3)), np.array([2.0]), middle)
    total = ((estimate.add_lamps(rest, SEEN, TURNED, near).radiance - 0.2) * solid_angles()[:, None, None]).sum()
    assert total == pytest.approx(3.0, rel=1e-3)  # never closer than its radius


def _wall(height: int) -> Occupancy:
    """A wall at x = 5 to 6 cells, up to a height in cells, in a grid of 20 cells of 0.1."""
    from scipy.ndimage import distance_transform_edt

    full = np.zeros((20, 20, 20), bool)
    full[5, :, :height] = True
    distance = distance_transform_edt(~full).astype(np.float32)
    return Occupancy(distance, np.zeros((20, 20, 20, 3), np.float32), np.zeros(3), 0.1)


def test_a_lamp_behind_a_wall_gives_no_light() -> None:
    position, up = np.array([1.5, 1.0, 0.05]), np.array([0.0, 0.0, 1.0])
    lamps = SphereLights(np.array([[0.1, 1.0, 0.5], [1.5, 1.0, 1.9]]), np.ones((2, 3)), np.full(2, 0.02), position)
    assert estimate.reaching_fraction(lamps, _wall(20), position, up, 0.6) == pytest.approx([0.0, 1.0])
    assert estimate.reaching_fraction(lamps, _wall(1), position, up, 0.6) == pytest.approx([1.0, 1.0], abs=0.2)
    part = estimate.reaching_fraction(lamps, _wall(6), position, up, 1.2)[0]
    assert 0.2 < part < 0.9  # the top of the object sees it, the foot does not


def test_the_visibility_of_a_lamp_is_sampled_by_4_points_and_6_heights() -> None:
    """A wall that is one cell higher each time changes the fraction in steps of 1/24."""
    position, up = np.array([1.5, 1.0, 0.05]), np.array([0.0, 0.0, 1.0])
    lamps = SphereLights(np.array([[0.1, 1.0, 0.9]]), np.ones((1, 3)), np.full(1, 0.6), position)
    found = [estimate.reaching_fraction(lamps, _wall(height), position, up, 1.4)[0] for height in range(1, 16)]
    lines = np.rint(24 * np.array(found)).astype(int)
    np.testing.assert_allclose(24 * np.array(found), lines, atol=1e-6)
    assert np.gcd.reduce(lines) == 1


class _Grey(SceneImages):
    """One grey image of a camera at the origin that looks along z."""

    def __init__(self) -> None:
        camera = Camera("PINHOLE", 64, 48, np.array([40.0, 40.0, 32.0, 24.0]))
        view = View("grey", camera, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, dtype=np.int64))
        self.scene = Scene(Path("memory"), "colmap", (view,), np.empty((0, 3)))
        self.rows = (0,)

    def image(self, row: int) -> NDArray[np.uint8]:
        return np.full((48, 64, 3), 128 + row, np.uint8)


def test_occluded_lamps_are_not_in_the_environment_map() -> None:
    position, cloud = np.array([1.5, 1.0, 0.05]), ColouredPoints(np.eye(3) * 2, np.ones((3, 3), np.float32), False)
    lamp = Lamp(np.array([[0.1, 1.0, 0.5]]), np.zeros((1, 3)), np.ones(1), np.array([5.0]), 0.02)
    open_room, behind_low_wall, behind_wall = (
        estimate.environment_at(position, 0.6, np.eye(3), cloud, _Grey(), RoomLight(0.1, (lamp,), occupancy))
        for occupancy in (None, _wall(1), _wall(20))
    )
    toward = np.array([-1.0, 0.0, 0.0])
    assert open_room.irradiance(toward)[0] > 3 * behind_wall.irradiance(toward)[0]
    assert behind_low_wall.irradiance(toward) == pytest.approx(open_room.irradiance(toward), rel=0.2)


def test_samples_are_averaged_by_direction() -> None:
    way = np.array([[0.0, 1.0, 0.1], [0.0, 1.0, 0.1], [1.0, 0.0, 0.1]])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    colours = np.array([[0.2, 0.4, 0.6], [0.4, 0.6, 0.8], [1.0, 1.0, 1.0]], np.float32)
    shown, known, sky = average_by_direction(DirectionSamples(way, colours, np.array([True, False, True])))
    row = int(np.arccos(way[0, 2]) / np.pi * HEIGHT)
    assert shown[row, WIDTH * 3 // 4] == pytest.approx([0.3, 0.5, 0.7])
    assert (known[row, WIDTH * 3 // 4], known[row, WIDTH // 2]) == (1.0, 0.5)
    assert np.count_nonzero(known) == 2
    assert (sky[row, WIDTH * 3 // 4], sky[row, WIDTH // 2]) == pytest.approx((0.5, 1.0))


def test_directions_to_the_support_show_it_in_the_closest_images() -> None:
    """Red to the left of the object and green to the right; a white occluder is in one of three images."""
    camera = Camera("PINHOLE", 200, 200, np.array([100.0, 100.0, 100.0, 100.0]))
    down = np.diag([1.0, -1.0, -1.0])  # from 4 above the support
    views = [
        View(f"{k}", camera, down, np.array([0.0, 0.0, 4.0]), np.empty((0, 2)), np.empty(0, int)) for k in range(3)
    ]
    colours = np.zeros((3, 200, 200, 3), np.uint8)
    colours[:, :, :100, 0] = colours[:, :, 100:, 1] = 255
    colours[1] = 255
    images: Any = SimpleNamespace(rows=(0, 1, 2), scene=SimpleNamespace(views=views), image=lambda row: colours[row])
    floor = DirectionSamples(
        np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.ones((2, 3), np.float32), np.zeros(2, bool)
    )
    samples = with_support(floor, np.array([0.0, 0.0, 0.5]), np.zeros(3), np.eye(3), images)
    assert (samples.directions[0] == [1.0, 0.0, 0.0]).all()  # the support hides what is below it
    assert samples.directions[1:, 2].max() < -0.2
    is_right = samples.directions[1:, 0] > 0.05
    assert is_right.sum() > 10_000
    np.testing.assert_allclose(
        samples.colours[1:][is_right], np.broadcast_to([0, 1, 0], (is_right.sum(), 3)), atol=1e-6
    )


def test_unseen_directions_have_the_colour_of_the_seen_border() -> None:
    shown, seen = np.full((HEIGHT, WIDTH, 3), [0.2, 0.3, 0.4]), np.zeros((HEIGHT, WIDTH))
    seen[20:40, 10:50] = 1.0
    filled = estimate.fill_unseen(shown * seen[..., None], seen)
    assert filled == pytest.approx(np.broadcast_to([0.2, 0.3, 0.4], filled.shape), rel=1e-6)
    shown[20:40, 10:50] = np.linspace(0, 1, 40)[None, :, None]
    assert estimate.fill_unseen(shown * seen[..., None], seen)[20:40, 10:50] == pytest.approx(shown[20:40, 10:50])


@pytest.mark.parametrize(("wanted", "level"), [(0.3, 0.3), (9.0, 0.1 * 8), (0.001, 0.1 * 0.3)])
def test_the_gain_of_unseen_directions_is_0_3_to_8(wanted: float, level: float) -> None:
    filled, seen = np.full((HEIGHT, WIDTH, 3), 0.1), np.zeros((HEIGHT, WIDTH))
    seen[:, :64] = 1.0
    raised = estimate.scale_unseen(filled, seen, wanted)
    assert raised[: HEIGHT // 2, 64:] == pytest.approx(level, rel=1e-6)
    assert raised[:, :64] == pytest.approx(0.1)
    assert raised[HEIGHT // 2 :] == pytest.approx(0.1)
    assert estimate.scale_unseen(filled, np.ones_like(seen), wanted) == pytest.approx(0.1)


def test_without_a_fitted_light_the_lamp_is_above_the_centre() -> None:
    generator = np.random.default_rng(0)
    room = ColouredPoints(generator.uniform([0, 0, 0], [8, 4, 2.5], (4000, 3)), np.ones((4000, 3), np.float32), True)
    toward = estimate.expected_lamp_direction(np.array([1.0, 1.0, 0.5]), np.eye(3), room)
    away = np.array([3.0, 1.0, 0.95 * 2.5 - 0.5])
    assert toward == pytest.approx(away / np.linalg.norm(away), abs=0.02)
    low = ColouredPoints(room.points * [1, 1, 0.01], room.colours, True)
    assert estimate.expected_lamp_direction(np.array([4.0, 2.0, 0.0]), np.eye(3), low)[2] > 0.99


def test_the_expected_lamp_has_60_percent_of_the_unseen_irradiance() -> None:
    filled, seen = np.full((HEIGHT, WIDTH, 3), [0.1, 0.2, 0.1]), np.zeros((HEIGHT, WIDTH))
    seen[HEIGHT // 2 :] = 1.0
    toward = np.array([0.6, 0.0, 0.8])
    raised = estimate.raise_ceiling(filled, seen, 0.12, toward)
    weight = np.maximum(map_directions()[..., 2], 0) * solid_angles()[:, None]
    far = map_directions() @ toward < 0
    rest = raised[far & (map_directions()[..., 2] > 0)]
    before, wanted = (float((weight * luminance(part)).sum()) for part in (filled, raised))
    assert luminance(rest) / luminance(filled[0, 0]) == pytest.approx((1 - LAMP_FRACTION) * wanted / before, rel=1e-6)
    lobe = (raised[..., 1] - rest[0, 1])[: HEIGHT // 2]
    cosine = np.maximum(map_directions() @ toward, 0.0)[: HEIGHT // 2]
    assert lobe / lobe.max() == pytest.approx((cosine / cosine.max()) ** LAMP_EXPONENT, abs=1e-9)
    assert raised[HEIGHT // 2 :] == pytest.approx(filled[HEIGHT // 2 :])


@pytest.mark.parametrize("furniture", [(0.35, 0.05, 0.04), (0.4, 0.25, 0.1), (0.05, 0.1, 0.35)])
@pytest.mark.parametrize("paper", [(0.6, 0.6, 0.6), (0.55, 0.6, 0.66)])
@pytest.mark.parametrize("has_lamp", [False, True])
def test_a_grey_card_has_the_colour_of_paper_among_coloured_furniture(
    furniture: tuple[float, float, float], paper: tuple[float, float, float], has_lamp: bool
) -> None:
    """All around is furniture, above nothing is seen, and one pixel in twenty is paper: the card was as red as this."""
    filled, seen = np.full((HEIGHT, WIDTH, 3), furniture), np.zeros((HEIGHT, WIDTH))
    seen[HEIGHT // 3 :] = 1.0
    pixels = np.where(np.arange(400)[:, None] % 20 == 0, paper, furniture).astype(np.float32)
    white = estimate.white_colour(pixels)
    raised = estimate.raise_ceiling(filled, seen, 0.6, np.array([0.0, 0.0, 1.0]))
    lamps = np.full(3, 0.8) if has_lamp else np.zeros(3)
    balanced, gain = estimate.balance_white(raised, seen, white, lamps)
    card = Environment(balanced, np.eye(3), SEEN).irradiance(np.array([0.0, 0.0, 1.0])) + gain * lamps
    np.testing.assert_allclose(card / card[1], np.array(paper) / paper[1], rtol=0.08)
    np.testing.assert_array_equal(balanced[seen == 1], filled[seen == 1])


@pytest.mark.parametrize(
    ("colour", "fraction", "is_white"),
    [((0.76, 0.6, 0.6), 0.02, True), ((0.78, 0.6, 0.6), 0.02, False), ((0.5, 0.6, 0.6), 0.009, False)],
)
def test_white_surfaces_are_one_percent_and_hardly_coloured(
    colour: tuple[float, float, float], fraction: float, is_white: bool
) -> None:
    pixels = np.tile([0.4, 0.2, 0.05], (1000, 1)).astype(np.float32)
    pixels[: round(1000 * fraction)] = colour
    expected = np.array(colour) / 0.6 if is_white else np.ones(3)
    white = estimate.white_colour(pixels)
    np.testing.assert_allclose(white / white[1], expected, rtol=1e-5)


@pytest.mark.parametrize(("elevation", "n"), [(0.0089, 0), (0.0111, 1)])
def test_lights_above_the_horizon_have_a_cosine_of_1_percent(elevation: float, n: int) -> None:
    direction = np.array([[np.sqrt(1 - elevation**2), 0.0, elevation]])
    lights = LightSamples(direction, np.ones((1, 3)), np.zeros(1), np.zeros(1))
    assert len(lights.above_horizon(np.array([0.0, 0.0, 1.0])).power) == n


@pytest.mark.parametrize(("ratio", "is_white"), [(0.42, True), (0.38, False)])
def test_white_surfaces_have_40_percent_of_the_luminance_of_the_brightest_ones(ratio: float, is_white: bool) -> None:
    furniture, tint = np.array([0.4, 0.2, 0.05]), np.array([1.1, 1.0, 1.0])
    pixels = np.tile(furniture, (1000, 1))
    pixels[:50] = ratio * float(luminance(furniture)) * tint / float(luminance(tint))
    white = estimate.white_colour(pixels.astype(np.float32))
    assert white[0] / white[1] == pytest.approx(1.1 if is_white else 1.0)
