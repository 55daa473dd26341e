"""Support planes and the objects on them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from estimator.geometry.category_rules import stands_on_floor
from estimator.geometry.planes import floor_of, height_peaks, level_basis, support_planes, voxel_downsample
from estimator.geometry.support import SupportCloud, SupportLevel, find_support_level, foot_on_level
from estimator.records.objects import SupportPlane
from tests.synthetic.shapes import box, floor, orbit, synthetic_scene

UP = np.array([0, 0, 1.0])
LOW, HIGH = np.array([0, 0, 0.0]), np.array([0.5, 0.4, 1.0])


@pytest.fixture(scope="module")
def room():
    objects = [floor(5), box("table", (1.4, 0.8, 0.72), (0, 0, 0)), box("box", (0.3, 0.3, 0.3), (0.2, 0, 0.72))]
    objects += [box(None, (5, 0.1, 2.4), (0, 2.5, 0))]
    return synthetic_scene(objects, orbit(10, 2.4, 1.6, size=(160, 120), focal=120.0), dense=30_000, noise=0.003)


def test_floor_and_table_are_found_at_their_heights(room):
    planes = support_planes(UP, voxel_downsample(room.scene.dense.points))
    assert [round(plane.height, 1) for plane in planes] == [0.0, 0.7]
    assert abs(planes[0].height) < 0.01
    assert abs(planes[1].height - 0.72) < 0.01
    assert floor_of(planes, room.scene.dense.points) is planes[0]


def test_a_plane_knows_where_it_was_seen(room):
    planes = support_planes(UP, voxel_downsample(room.scene.dense.points))
    table = np.random.default_rng(0).uniform([-0.6, -0.3], [0.6, 0.3], (50, 2)) @ planes[1].basis[:2, :2].T
    index = np.floor((table - planes[1].origin) / planes[1].cell).astype(int)
    assert planes[1].cells[tuple(index.T)].mean() > 0.8


def test_a_glossy_floor_is_the_floor_though_its_mirror_images_are_below(room):
    """One point in ten is the mirror image of something that is on the floor."""
    points = room.scene.dense.points
    random = np.random.default_rng(0)
    above = points[(points[:, 2] > 0.05) & (points[:, 2] < 0.7)]
    images = above[random.choice(len(above), len(points) // 9)] * [1, 1, -1]
    glossy = np.vstack([points, images])
    ground = floor_of(support_planes(UP, voxel_downsample(glossy)), glossy)
    assert ground is not None
    assert abs(ground.height) < 0.01


def test_a_table_is_no_floor(room):
    """If much of the cloud is below the lowest plane, this plane is not the floor."""
    points = room.scene.dense.points
    planes = support_planes(UP, voxel_downsample(points))
    assert floor_of(planes[1:], points) is None
    assert floor_of((), points) is None


@given(st.integers(0, 1000), st.floats(1e-3, 1e3))
@settings(max_examples=10, deadline=None)
def test_heights_turn_and_grow_with_the_scene(room, seed, scale):
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    points = room.scene.dense.points
    planes = support_planes(turn @ UP, voxel_downsample(scale * points @ turn.T))
    assert len(planes) == 2
    assert planes[1].height - planes[0].height == pytest.approx(0.72 * scale, rel=0.03)


def test_level_basis_is_right_handed():
    for up in (UP, -UP, np.array([1.0, 0, 0]), np.array([0.6, 0, 0.8])):
        basis = level_basis(up)
        assert np.allclose(basis @ basis.T, np.eye(3))
        assert np.linalg.det(basis) == pytest.approx(1)
        assert np.allclose(basis[2], up)


def test_few_points_have_no_planes():
    assert support_planes(UP, np.empty((0, 3))) == ()
    assert support_planes(UP, np.zeros((5, 3))) == ()
    assert SupportCloud.from_points(np.empty((0, 3)), None) is None


def corners(x, y, half=0.15):
    return np.array([[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]])


def test_the_level_around_an_object_is_found_though_hidden_below_it(room):
    """The box on the table: the surface it hides is read off around it; next to the table it is the floor."""
    points = room.scene.dense.points
    basis = np.eye(3)
    planes = support_planes(UP, voxel_downsample(points))
    ground = SupportCloud.from_points(voxel_downsample(points) @ basis.T, floor_of(planes, points))
    on_table = find_support_level(ground, corners(0.2, 0), np.array([0, 0, 0.75]), np.array([0.3, 0.3, 1.02]), None)
    assert on_table.height == pytest.approx(0.72, abs=0.015)
    on_floor = find_support_level(ground, corners(1.2, -1.0), np.array([0, 0, 0.1]), np.array([0.3, 0.3, 1.0]), None)
    assert on_floor.height == pytest.approx(0.0, abs=0.015)


def test_a_small_gap_is_filled_and_a_large_one_is_not():
    foot = foot_on_level(SupportLevel(-0.2, 0.01), LOW, HIGH, 0.01, None, np.nan)
    assert foot.is_extended
    assert foot.bottom == -0.2
    assert foot.sigma > 0.005
    hanging = foot_on_level(SupportLevel(-1.0, 0.01), LOW, HIGH, 0.01, None, np.nan)
    assert not hanging.is_supported
    assert hanging.bottom == 0


def test_masks_decide_where_they_tell():
    level = SupportLevel(-0.3, 0.01)
    assert foot_on_level(level, LOW, HIGH, 0.01, None, 0.9).is_extended
    assert not foot_on_level(level, LOW, HIGH, 0.01, None, 0.1).is_extended


def test_objects_that_hang_are_never_dropped_to_the_floor():
    assert not foot_on_level(SupportLevel(-0.3, 0.01), LOW, HIGH, 0.01, False, 0.9).is_extended
    assert not foot_on_level(SupportLevel(-1.5, 0.01), LOW, HIGH, 0.01, stands_on_floor("clock"), np.nan).is_extended


def test_a_table_top_reaches_the_floor_and_says_so_without_one():
    low, high = np.array([0, 0, 0.68]), np.array([1.2, 0.8, 0.74])
    foot = foot_on_level(SupportLevel(0.0, 0.01), low, high, 0.01, stands_on_floor("desk"), np.nan)
    assert foot.is_extended
    assert high[2] - foot.bottom == pytest.approx(0.74)
    assert foot.sigma > 0.03
    without = foot_on_level(None, low, high, 0.01, stands_on_floor("desk"), np.nan)
    assert without.is_truncated
    assert not foot_on_level(None, low, high, 0.01, stands_on_floor("keyboard"), np.nan).is_truncated


def test_contact_settles_the_foot_on_the_level():
    foot = foot_on_level(SupportLevel(0.02, 0.005), LOW, HIGH, 0.03, None, np.nan)
    assert foot.is_supported
    assert not foot.is_extended
    assert foot.bottom == 0.02


@pytest.mark.parametrize(
    ("category", "answer"),
    [
        ("chair", True),
        ("swivel chair", True),
        ("office_chair", True),
        ("Dining Table", True),
        ("wall clock", False),
        ("picture frame", False),
        ("ceiling lamp", False),
        ("floor lamp", True),
        ("lamp", None),
        ("table lamp", None),
        ("cabinet", None),
        ("bottle", None),
        ("", None),
    ],
)
def test_the_name_settles_who_stands(category, answer):
    assert stands_on_floor(category) is answer


@pytest.mark.parametrize(
    ("gap", "stands", "reach", "is_extended"),
    [
        (0.34, None, np.nan, True),  # MAX_UNOBSERVED_GAP of 0.35
        (0.36, None, np.nan, False),
        (0.11, None, 0.0, True),  # MAX_OBSERVED_GAP of 0.12
        (0.13, None, 0.0, False),
        (0.5, None, 0.51, True),  # MIN_REACH_FRACTION of 0.5
        (0.5, None, 0.49, False),
        (11.9, True, np.nan, True),  # MAX_FLOOR_GAP of 12
        (12.1, True, np.nan, False),
        (0.1, False, 1.0, False),
    ],
)
def test_both_sides_of_the_gaps_that_are_filled(gap, stands, reach, is_extended):
    """Gaps are relative to the height of the object, 1 unit."""
    low, high = np.array([0.0, 0.0, 0.0]), np.array([0.5, 0.5, 1.0])
    foot = foot_on_level(SupportLevel(-gap, 0.0), low, high, 0.01, stands, reach)
    assert foot.is_extended == is_extended
    assert foot.bottom == (-gap if is_extended else 0.0)


@pytest.mark.parametrize(("gap", "touches"), [(0.055, True), (0.065, False)])
def test_a_foot_touches_its_level_within_six_per_cent_of_the_height(gap, touches):
    """On each side of `MAX_CONTACT_FRACTION`; a hanging object is not extended."""
    low, high = np.array([0.0, 0.0, 0.0]), np.array([0.5, 0.5, 1.0])
    assert foot_on_level(SupportLevel(-gap, 0.0), low, high, 0.01, False, np.nan).is_supported == touches


@pytest.mark.parametrize(("height", "is_truncated"), [(0.34, True), (0.36, False)])
def test_a_flat_object_on_the_floor_has_no_legs(height, is_truncated):
    """On each side of `MAX_SLAB_ASPECT`, relative to the smaller side, 1 unit."""
    foot = foot_on_level(None, np.zeros(3), np.array([2.0, 1.0, height]), 0.01, True, np.nan)
    assert foot.is_truncated == is_truncated


def plane_at(height, side):
    """A level plane of side x side cells of 1."""
    return SupportPlane(np.eye(3), height, 0.0, side**2, np.zeros(2), 1.0, np.ones((side, side), dtype=bool))


@pytest.mark.parametrize(
    ("side", "below", "is_floor"),
    [(3, 0.04, True), (3, 0.06, False), (8, 0.14, True), (8, 0.16, False)],
    ids=["small", "small, above points", "wide and glossy", "wide, above points"],
)
def test_a_floor_has_few_points_below_it(side, below, is_floor):
    """At most 5 %; 15 % if it is at least half as wide as the widest plane, because mirror images are below it."""
    planes = [plane_at(0.0, side), plane_at(5.0, 10)]
    points = np.zeros((100, 3))
    points[: round(100 * below), 2] = -9.0
    ground = floor_of(planes, points)
    assert (ground is planes[0]) == is_floor


@pytest.mark.parametrize(("in_plane", "is_found"), [(0.007, False), (0.012, True)])
def test_a_surface_has_at_least_eight_points_in_a_thousand(in_plane, is_found):
    """In a hall of 40,000 points at all heights up to 10, of which a table top has a few."""
    rng = np.random.default_rng(0)
    count = round(40_000 * in_plane)
    heights = np.concatenate([rng.uniform(0.0, 3.0, 40_000 - count), rng.normal(6.0, 0.001, count), [0.0, 10.0]])
    found = height_peaks(heights, 0.02)
    assert any(abs(height - 6.0) < 0.05 for height in found) == is_found


def _ring_of(n_points, angles_deg, height):
    """Points (n, 3) at a height, at a distance of 0.6 around the origin, equally many in each direction."""
    angles = np.radians(np.repeat(angles_deg, n_points // len(angles_deg)))
    return np.column_stack([0.6 * np.cos(angles), 0.6 * np.sin(angles), np.full(len(angles), height)])


def _level_of(points, low=(0.0, 0.0, 0.0), high=(1.0, 1.0, 1.0), stands=None, ground=None):
    """Height of the level of an object with a footprint of 1 x 1 around the origin; bins are 0.01 high."""
    cloud = SupportCloud(points, 0.01, ground)
    level = find_support_level(cloud, corners(0, 0, 0.5), np.array(low), np.array(high), stands)
    return None if level is None else round(level.height, 3)


@pytest.mark.parametrize(
    ("n_points", "angles_deg", "is_found"),
    [
        (12, (10, 100, 190), True),  # MIN_RING_POINTS of 10 and MIN_RING_SECTORS of 3
        (9, (10, 100, 190), False),
        (40, (10, 100), False),
    ],
)
def test_a_level_has_ten_points_in_three_of_eight_directions(n_points, angles_deg, is_found):
    points = np.concatenate([_ring_of(n_points, angles_deg, -0.2), [[0.7, 0.7, -3.0]]])
    assert _level_of(points) == (-0.2 if is_found else None)


@pytest.mark.parametrize(("distance", "is_found"), [(1.0, True), (1.2, False)])
def test_the_ring_around_a_footprint_is_six_tenths_of_its_side_wide(distance, is_found):
    points = _ring_of(24, (0, 90, 180, 270), -0.2) * [distance / 0.6, distance / 0.6, 1]
    assert _level_of(np.concatenate([points, [[0.7, 0.7, -3.0]]])) == (-0.2 if is_found else None)


@pytest.mark.parametrize(("upper", "height"), [(36, -0.2), (24, -0.5)])
def test_the_highest_level_with_three_tenths_of_the_points_is_used(upper, height):
    """A shelf of `upper` points above a table with 100."""
    points = [_ring_of(upper, (0, 90, 180, 270), -0.2), _ring_of(100, (0, 90, 180, 270), -0.5), [[0.7, 0.7, -3.0]]]
    assert _level_of(np.concatenate(points)) == height


@pytest.mark.parametrize(("height", "is_found"), [(-0.06, True), (-0.04, False)])
def test_the_support_of_a_slab_is_half_its_thickness_below_it(height, is_found):
    points = np.concatenate([_ring_of(24, (0, 90, 180, 270), height), [[0.7, 0.7, -3.0]]])
    assert _level_of(points, high=(1.0, 1.0, 0.1), stands=True) == (height if is_found else None)


def test_the_error_of_a_foot_on_a_level():
    """0.3 of the roughness of the level, and 5 % of the filled part of the height."""
    low, high = np.array([0.0, 0.0, 0.0]), np.array([0.5, 0.5, 1.0])
    assert foot_on_level(SupportLevel(0.0, 0.1), low, high, 0.01, None, np.nan).sigma == pytest.approx(0.03)
    filled = foot_on_level(SupportLevel(-0.25, 0.1), low, high, 0.01, None, np.nan)
    assert filled.sigma == pytest.approx(np.hypot(0.3 * 0.1 / 1.25, 0.05 * 0.25 / 1.25))


@pytest.mark.parametrize(("gap", "is_closed"), [(0.1, True), (0.113, False)])
def test_a_plane_has_no_hole_at_a_gap_of_a_tenth_of_the_height_of_the_scene(gap, is_closed):
    """Two parts of a floor and a post of height 1; the map has cells of six of 150 height bins, and one around them."""
    steps = np.arange(100) / 75
    part = np.stack([*np.meshgrid(steps, steps, indexing="ij"), np.zeros((100, 100))], axis=-1).reshape(-1, 3)
    post = np.linspace([0.0, 0.0, 0.0], UP, 3000)
    points = np.concatenate([part, part + np.array([steps[-1] + gap, 0, 0]), post])
    (floor, *_) = support_planes(UP, points)
    row = floor.cells[:, floor.cells.shape[1] // 2]
    first, *_, last = np.flatnonzero(row)
    assert row[first:last].all() == is_closed


def heights_of(counts):
    """Heights in bins of one unit, with so many at the middle of each bin; the lowest is at 0.5."""
    return np.concatenate([np.full(count, row + 0.5) for row, count in counts.items()])


@pytest.mark.parametrize(
    ("counts", "peaks"),
    [
        ({row: 100 + 340 * (row == 75) for row in range(150)}, []),  # MIN_PEAK_TO_MEDIAN: 1.9 after smoothing
        ({row: 100 + 420 * (row == 75) for row in range(150)}, [75]),  # 2.1
        ({20: 10_000, 60: 75}, [20]),  # MIN_PLANE_FRACTION: 0.74 %
        ({20: 10_000, 60: 86}, [20, 60]),  # 0.85 %
        ({20: 2000, 60: 24}, [20]),  # MIN_POINTS
        ({20: 2000, 60: 25}, [20, 60]),
        ({20: 2000, 58: 12, 62: 12, 60: 2}, [20, 60]),  # within two bins of the peak
        ({20: 2000, 57: 12, 63: 12, 60: 5}, [20]),
        ({0: 20, 20: 1000, 23: 900, 150: 20}, [21]),  # MIN_BINS_APART: the second is a surface up to bin 25
        ({0: 20, 20: 1000, 24: 900, 150: 20}, [20, 26]),
    ],
)
def test_both_sides_of_what_a_level_surface_is(counts, peaks):
    heights = heights_of(counts)
    low = np.percentile(heights, 0.5)
    found = height_peaks(heights, 1.0)
    assert [round(height - low - 0.5) + min(counts) for height in found] == peaks


@pytest.mark.parametrize(("height", "n_points"), [(2.8, 1020), (3.2, 1000)])
def test_a_level_surface_is_two_and_a_half_bins_thick_to_each_side(height, n_points):
    """150 bins between the outer points; the peak is half a bin above the lowest."""
    heights = heights_of({0: 1000, 150: 1000}) - 0.5
    points = np.column_stack([np.tile(np.linspace(0, 60, 1000), 2), np.zeros(2000), heights])
    points = np.vstack([points, np.tile([0, 0, height], (20, 1))])
    plane = support_planes(UP, points)[0]
    assert (plane.points, plane.cell) == (n_points, pytest.approx(6.0))


def level(height, n_cells):
    return SupportPlane(np.eye(3), height, 0.01, 100, np.zeros(2), 0.6, np.ones((1, n_cells), dtype=bool))


@pytest.mark.parametrize(
    ("n_cells", "n_below", "row"),
    [
        (55, 140, 0),  # a wide plane with 14 % of the points below
        (55, 160, 1),
        (45, 140, 1),  # MIN_WIDE_FRACTION: no wide plane
        (45, 45, 0),
        (45, 55, 1),
    ],
)
def test_the_floor_has_few_points_below(n_cells, n_below, row):
    """A point is below from half a unit (five bins) below the plane."""
    planes = [level(0.0, n_cells), level(1.0, 100)]
    points = np.zeros((1000, 3))
    points[:n_below, 2] = -0.55
    points[n_below:, 2] = -0.45
    assert floor_of(planes, points) is (planes[0] if row == 0 else None)
    points[:, 2] += 0.55
    assert floor_of(planes[:1], points) is planes[0]


@pytest.mark.parametrize(("x", "is_y"), [(0.88, False), (-0.88, False), (0.92, True), (-0.92, True)])
def test_the_first_axis_is_that_of_y_near_a_vertical_along_x(x, is_y):
    first = level_basis(np.array([x, 0, np.sqrt(1 - x**2)]))[0]
    assert (first[1] == 1) == is_y


@pytest.mark.parametrize(("n_points", "n_kept"), [(24, 24), (10_001, 209)])
def test_a_cloud_has_200_voxels_along_its_diagonal(n_points, n_kept):
    points = np.column_stack([np.linspace(0, 1, n_points), np.zeros((n_points, 2))])
    assert len(voxel_downsample(points)) == pytest.approx(n_kept, abs=1)
