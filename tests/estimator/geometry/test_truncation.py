"""Which sides are cut: image border, something closer, a side no view sees, a mask that outreaches the points."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_array

from estimator.association.point_labels import dense_labels
from estimator.geometry.mask_outlines import mask_contour
from estimator.geometry.truncation import MaskOutline, SideVisibility, mask_outline, side_visibility
from estimator.projection.visibility import DepthImages
from estimator.records.scene import Camera, Instance, Scene, View
from tests.synthetic.shapes import box, cylinder, floor, orbit, synthetic_scene, view_at

UP = np.array([0, 0, 1.0])
LOW_END, HIGH_END = 0, 1


def outline(mask, width, height):
    """The outline of a mask in an image of the given size."""
    return mask_outline(mask, mask_contour(mask), width, height)


def sides_of(synthetic, number, axes, low, high, instances=None, points=None):
    """How the masks of object number `number` show the sides of the given true box."""
    instances = synthetic.instances if instances is None else instances
    labels = dense_labels(synthetic.scene, instances)
    masks = [instance for instance in instances if instance.track == str(number)]
    borders = [outline(mask, 200, 150) for mask in masks]
    points = synthetic.scene.dense.points[synthetic.owner == number] if points is None else points
    around = DepthImages(synthetic.scene, labels.points, labels.visibility, UP)
    return side_visibility(masks, borders, around, (axes, np.asarray(low, float), np.asarray(high, float)), points)


def views_around(radius=2.5, height=1.4, count=8, arc=360.0):
    return orbit(count, radius, height, arc=arc, size=(200, 150), focal=160.0)


def test_an_object_seen_whole_from_all_around_is_cut_nowhere():
    synthetic = synthetic_scene([floor(6), box("cabinet", (0.6, 0.4, 0.8), (0, 0, 0))], views_around(), dense=8000)
    sides = sides_of(synthetic, 1, np.eye(3), [-0.3, -0.2, 0], [0.3, 0.2, 0.8])
    assert not sides.truncated.any()
    assert sides.is_shown.shape == (8, 3, 2)


def test_the_image_border_cuts_the_side_towards_it():
    """A long bench that leaves the image at +x in every view."""
    eyes = [np.array([-1.2 + 0.05 * k, -2.2, 1.3]) for k in range(4)]
    views = [view_at(eye, np.add(eye, [0.1, 2.2, -0.9]), "v", size=(200, 150), focal=160.0) for eye in eyes]
    synthetic = synthetic_scene([floor(8), box("bench", (4.0, 0.4, 0.45), (0.8, 0, 0))], views, dense=8000)
    found = synthetic.scene.dense.points[synthetic.owner == 1]
    sides = sides_of(synthetic, 1, np.eye(3), found.min(axis=0), found.max(axis=0))
    assert sides.truncated[0, HIGH_END]
    assert not sides.truncated[2].any()


@pytest.mark.parametrize(("clean", "truncated"), [(1, True), (2, False)])
def test_two_clean_views_undo_the_cut_and_one_does_not(clean, truncated):
    near = [np.array([-1.2, -2.2, 1.3]), np.array([-1.1, -2.2, 1.3])]
    far = [np.array([0.8, -4.5, 2.0]), np.array([0.9, -4.5, 2.0])][:clean]
    eyes = near + far
    targets = [np.add(eye, [0.1, 2.2, -0.9]) for eye in near] + [np.array([0.8, 0, 0.2])] * clean
    views = [view_at(e, t, "v", size=(200, 150), focal=160.0) for e, t in zip(eyes, targets, strict=True)]
    synthetic = synthetic_scene([floor(9), box("bench", (4.0, 0.4, 0.45), (0.8, 0, 0))], views, dense=8000)
    sides = sides_of(synthetic, 1, np.eye(3), [-1.2, -0.2, 0], [2.8, 0.2, 0.45])
    assert sides.truncated[0, HIGH_END] == truncated


def test_something_nearer_cuts_and_the_table_it_stands_on_does_not():
    """A box half hidden behind a board that no detector names; the floor in front of it is no cover."""
    board = box(None, (0.6, 0.03, 1.2), (0.55, -0.6, 0))
    eyes = [np.array([x, -3.0, 1.0]) for x in (-0.1, 0.0, 0.1)]
    views = [view_at(eye, np.array([0, 0, 0.4]), "v", size=(200, 150), focal=180.0) for eye in eyes]
    synthetic = synthetic_scene(
        [floor(8), box("cabinet", (1.0, 0.4, 0.7), (0, 0, 0)), board], views, dense=20_000, noise=0.001
    )
    found = synthetic.scene.dense.points[synthetic.owner == 1]
    sides = sides_of(synthetic, 1, np.eye(3), found.min(axis=0), found.max(axis=0))
    assert sides.truncated[0, HIGH_END]
    assert not sides.truncated[0, LOW_END]
    assert not sides.truncated[2, LOW_END]


def test_the_back_of_a_round_object_seen_from_one_side_is_cut():
    """A bottle seen from the front shows half its wall, so that its depth is unknown."""
    views = orbit(6, 1.0, 0.2, arc=40, target=(0, 0, 0.15), size=(200, 150), focal=220.0)
    synthetic = synthetic_scene(
        [floor(3), cylinder("bottle", (0.09, 0.09, 0.3), (0, 0, 0))], views, dense=12_000, noise=0.0005
    )
    found = synthetic.scene.dense.points[synthetic.owner == 1]
    sides = sides_of(synthetic, 1, np.eye(3), found.min(axis=0), found.max(axis=0))
    assert sides.truncated[1, HIGH_END]
    assert not sides.truncated[0].any()


def test_the_back_of_a_table_is_outlined_by_its_top():
    views = orbit(6, 2.6, 2.0, arc=40, target=(0, 0, 0.5), size=(200, 150), focal=160.0)
    synthetic = synthetic_scene(
        [floor(6), box("table", (1.2, 0.7, 0.05), (0, 0, 0.7))], views, dense=12_000, noise=0.001
    )
    sides = sides_of(synthetic, 1, np.eye(3), [-0.6, -0.35, 0.7], [0.6, 0.35, 0.75])
    assert not sides.truncated[:2].any()


@pytest.mark.parametrize("n_both", [0, 1])
def test_an_extent_whose_ends_no_view_shows_together_is_truncated(n_both: int) -> None:
    is_shown = np.zeros((5, 3, 2), dtype=bool)
    is_shown[:2, :, LOW_END] = is_shown[2:4, :, HIGH_END] = True
    is_shown[4:] = n_both > 0
    truncated = SideVisibility(is_shown, np.zeros((5, 3, 2))).truncated
    assert truncated.any(axis=1).tolist() == [n_both == 0] * 3


@pytest.mark.parametrize("n_trimmed", [0, 3])
def test_a_mask_that_goes_further_than_the_points_says_so(n_trimmed):
    """The top third of a cabinet left no points, or some that the box excludes: its masks show it."""
    synthetic = synthetic_scene(
        [floor(6), box("cabinet", (0.6, 0.4, 0.9), (0, 0, 0))], views_around(height=0.6), dense=8000
    )
    points = synthetic.scene.dense.points
    keep = ~((synthetic.owner == 1) & (points[:, 2] > 0.6))
    keep[np.flatnonzero((synthetic.owner == 1) & (points[:, 2] > 0.88))[:n_trimmed]] = True
    bare = type(synthetic)(
        type(synthetic.scene)(
            synthetic.scene.path,
            "memory",
            synthetic.scene.views,
            synthetic.scene.points,
            type(synthetic.scene.dense)(points[keep]),
        ),
        synthetic.instances,
        synthetic.objects,
        synthetic.owner[keep],
    )
    sides = sides_of(bare, 1, np.eye(3), [-0.3, -0.2, 0], [0.3, 0.2, 0.6])
    assert sides.truncated[2, HIGH_END]
    assert sides.median_excess[2, HIGH_END] == pytest.approx(0.5, abs=0.15)
    assert not sides.truncated[2, LOW_END]


def test_a_boxs_border_says_nothing_about_the_outline():
    synthetic = synthetic_scene([floor(6), cylinder("bin", (0.5, 0.5, 0.7), (0, 0, 0))], views_around(), dense=6000)
    boxes = tuple(
        Instance(i.id, i.view, i.category, np.ones_like(i.mask), i.origin, i.score, True, i.track)
        for i in synthetic.instances
    )
    sides = sides_of(synthetic, 1, np.eye(3), [-0.25, -0.25, 0], [0.25, 0.25, 0.5], boxes)
    assert np.isnan(sides.median_excess).all()


def test_outline_of_an_empty_mask_is_empty():
    empty = outline(Instance("1", 0, "cup", np.zeros((3, 3), dtype=bool), (0, 0)), 20, 20)
    assert empty.pixels.shape == (0, 2)


def test_outline_knows_the_border():
    inner = outline(Instance("1", 0, "cup", np.ones((4, 4), dtype=bool), (8, 8)), 20, 20)
    assert not inner.is_at_border.any()
    left = outline(Instance("1", 0, "cup", np.ones((4, 4), dtype=bool), (0, 8)), 20, 20)
    assert left.is_at_border.any()
    assert not left.is_at_border.all()


@pytest.mark.parametrize(("excess", "truncated"), [(0.055, False), (0.065, True)])
def test_masks_exceed_the_points_from_six_per_cent(excess, truncated):
    """On each side of `MIN_EXCESS_FRACTION`."""
    sides = SideVisibility(np.ones((3, 3, 2), dtype=bool), np.full((3, 3, 2), excess))
    assert (sides.truncated == truncated).all()


@pytest.mark.parametrize(("views", "truncated"), [(1, True), (2, False)])
def test_a_side_is_complete_if_two_views_show_it(views, truncated):
    """On each side of `MIN_COMPLETE_VIEWS`; the excess of the masks is unknown with a single view."""
    is_shown = np.arange(4)[:, None, None] < views
    sides = SideVisibility(np.broadcast_to(is_shown, (4, 3, 2)), np.full((4, 3, 2), np.nan))
    assert (sides.truncated == truncated).all()


@pytest.mark.parametrize(("n_views", "truncated"), [(1, True), (2, False)])
@pytest.mark.parametrize("end", [LOW_END, HIGH_END])
def test_an_extent_is_truncated_unless_two_views_compare_masks_and_points_at_one_end(n_views, truncated, end):
    """On each side of `MIN_COMPLETE_VIEWS`; a single view is enough if there is no other."""
    excess = np.full((4, 3, 2), np.nan)
    excess[:n_views, :, end] = 0.0
    needs_excess = np.array([True, True, False])
    sides = SideVisibility(np.ones((4, 3, 2), dtype=bool), excess, needs_excess)
    assert sides.truncated.tolist() == [[truncated] * 2, [truncated] * 2, [False] * 2]
    assert not SideVisibility(sides.is_shown[:1], excess[:1], needs_excess).truncated.any()


def sides_in_two_views(box_at, pixels, is_at_border, images=None, from_box=True):
    """Visibility of the sides of a box in two equal views from the origin along z, with y down."""
    camera = Camera("PINHOLE", 200, 150, np.array([160.0, 160.0, 100.0, 75.0]))
    view = View("v", camera, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, dtype=np.int64))
    points = np.array([[x, y, 2.0] for x in (-0.3, 0.3) for y in (-0.2, 0.2)])
    scene = Scene(Path("memory"), "memory", (view, view), points)
    images = images or DepthImages(scene, points, csr_array(np.ones((2, 4))), UP)
    images = SimpleNamespace(scene=scene, depths_and_heights=images.depths_and_heights)
    masks = [Instance("1", row, "box", np.ones((30, 48), dtype=bool), (76, 60), from_box=from_box) for row in (0, 1)]
    return side_visibility(masks, [MaskOutline(pixels, is_at_border)] * 2, images, box_at, points)


Y = np.linspace(60.0, 90.0, 101)
#: Left and right side of an outline.
OUTLINE = np.vstack([np.column_stack([np.full(101, x), Y]) for x in (76.0, 124.0)])
#: Axes, low and high ends of a box in front of the camera: length along x, height upwards.
AHEAD = (np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([-0.3, 1.9, -0.2]), np.array([0.3, 2.1, 0.2]))


def test_a_side_behind_the_camera_is_truncated():
    """A wall that passes the camera: the centre of its end behind the camera has no direction in the image."""
    axes = np.array([[0.0, 0, 1], [1, 0, 0], [0, -1, 0]])
    wall = (axes, np.array([-1.0, 0.9, -0.1]), np.array([3.0, 1.1, 0.1]))
    sides = sides_in_two_views(wall, OUTLINE, np.zeros(202, dtype=bool))
    assert sides.truncated[0].tolist() == [True, False]


@pytest.mark.parametrize(("height", "truncated"), [(-0.165, False), (-0.155, True)])
def test_an_occluder_is_above_the_foot(height, truncated):
    """On each side of `MIN_OCCLUDER_HEIGHT`: the floor in front of an object is closer than the object."""

    def depths_and_heights(_, pixels):
        n = len(pixels) // 2  # outside of the outline, then inside
        return np.repeat([1.0, 2.0], n), np.full(2 * n, height)

    images = SimpleNamespace(depths_and_heights=depths_and_heights)
    sides = sides_in_two_views(AHEAD, OUTLINE, np.zeros(202, dtype=bool), images, from_box=False)
    assert (sides.is_shown[:, 0] != truncated).all()


@pytest.mark.parametrize(("depth", "truncated"), [(1.935, False), (1.915, True)])
def test_an_occluder_is_in_front_by_a_tenth_of_the_diagonal(depth, truncated):
    """On each side of `MIN_OCCLUDER_DISTANCE`, for an object at 2 with a diagonal of 0.75."""

    def depths_and_heights(_, pixels):
        return np.repeat([depth, 2.0], len(pixels) // 2), np.zeros(len(pixels))

    images = SimpleNamespace(depths_and_heights=depths_and_heights)
    sides = sides_in_two_views(AHEAD, OUTLINE, np.zeros(202, dtype=bool), images, from_box=False)
    assert (sides.is_shown[:, 0] != truncated).all()


@pytest.mark.parametrize(("touching", "truncated"), [(0.2, False), (0.3, True)])
def test_a_quarter_of_the_outer_outline_at_the_border_truncates_a_side(touching, truncated):
    """On each side of `MIN_CUT_FRACTION`: a part of the right outline is at the border of the image."""
    is_at_border = np.zeros(202, dtype=bool)
    is_at_border[101 : 101 + round(101 * touching)] = True
    sides = sides_in_two_views(AHEAD, OUTLINE, is_at_border)
    assert sides.truncated[0].tolist() == [False, truncated]


@pytest.mark.parametrize(
    ("excess", "n_shown", "is_truncated"),
    [(0.059, 3, False), (0.061, 3, True), (0.0, 2, False), (0.0, 1, True)],
)
def test_a_side_is_truncated_by_an_excess_of_six_percent_or_by_fewer_than_two_views(
    excess: float, n_shown: int, is_truncated: bool
) -> None:
    is_shown = np.ones((3, 3, 2), dtype=bool)
    is_shown[n_shown:, 0, 1] = False
    excesses = np.zeros((3, 3, 2))
    excesses[:, 0, 1] = excess
    truncated = SideVisibility(is_shown, excesses).truncated
    assert truncated[0, 1] == is_truncated
    assert truncated.sum() == is_truncated


@pytest.mark.parametrize(("n_known", "is_known"), [(1, False), (2, True)])
def test_an_excess_is_known_from_two_views(n_known: int, is_known: bool) -> None:
    excesses = np.full((3, 3, 2), 0.2)
    excesses[n_known:] = np.nan
    assert np.isfinite(SideVisibility(np.ones((3, 3, 2), dtype=bool), excesses).median_excess).all() == is_known


@pytest.mark.parametrize(
    ("fraction", "inside", "depth", "truncated"),
    [
        (0.55, 0.05, 0.05, False),  # MIN_TOP_FRACTION of 0.5
        (0.45, 0.05, 0.05, True),
        (0.55, 0.05, 0.22, False),  # TOP_BAND of a quarter of the height
        (0.55, 0.05, 0.28, True),
        (0.45, 0.15, 0.05, False),  # END_BAND of an eighth of the width: the points below the top are not at the end
        (0.45, 0.11, 0.05, True),
    ],
)
def test_a_top_outlines_a_side_if_it_is_next_to_it(fraction, inside, depth, truncated):
    """Points at both ends of the width: a fraction on the top, the others below it and further inside."""
    views = orbit(4, 2.6, 0.75 + 2.6, arc=2, target=(0, 0, 0.75), size=(200, 150), focal=160.0)
    synthetic = synthetic_scene([floor(6), box("table", (1.2, 0.7, 0.05), (0, 0, 0.7))], views, dense=4000)
    low, high = np.array([-0.6, -0.35, 0.7]), np.array([0.6, 0.35, 0.75])
    n_top = round(100 * fraction)
    along = np.concatenate([np.full(n_top, 0.05), np.full(100 - n_top, inside)])
    heights = np.concatenate([np.full(n_top, 1 - depth), np.full(100 - n_top, 0.1)])
    ends = [np.column_stack([np.linspace(0.1, 0.9, 100), end, heights]) for end in (along, 1 - along)]
    points = low + np.concatenate(ends) * (high - low)
    sides = sides_of(synthetic, 1, np.eye(3), low, high, points=points)
    assert sides.is_shown[:, 1].all() != truncated


@pytest.mark.parametrize(("height", "needs_excess"), [(1.38, False), (1.42, True)])
def test_a_top_outlines_an_extent_of_at_least_half_the_height(height, needs_excess):
    """On each side of `MIN_TOP_ASPECT`: all points are on the top of a box that is 0.7 wide."""
    views = orbit(4, 2.6, 0.75 + 2.6, arc=2, target=(0, 0, 0.75), size=(200, 150), focal=160.0)
    synthetic = synthetic_scene([floor(6), box("table", (1.2, 0.7, 0.05), (0, 0, 0.7))], views, dense=4000)
    low, high = np.array([-0.6, -0.35, 0.75 - height]), np.array([0.6, 0.35, 0.75])
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 20), np.linspace(-0.35, 0.35, 20))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(400, 0.75)])
    assert sides_of(synthetic, 1, np.eye(3), low, high, points=points).needs_excess[1] == needs_excess


@pytest.mark.parametrize(("excess", "truncated"), [(0.055, False), (0.065, True)])
def test_the_excess_of_the_only_view_is_known(excess: float, truncated: bool) -> None:
    """Of a photograph, or of an object with one mask."""
    assert (SideVisibility(np.ones((1, 3, 2), dtype=bool), np.full((1, 3, 2), excess)).truncated == truncated).all()


@pytest.mark.parametrize(("inwards", "truncated"), [(0.1, True), (0.14, False)])
def test_the_outer_outline_is_an_eighth_of_the_extent(inwards, truncated):
    """On each side of `OUTER_FRACTION` of 0.12: the part of the outline at the border is this far from its end."""
    near = np.column_stack([np.full(101, 124.0 - 48 * inwards), Y])
    outline = np.vstack([OUTLINE, near])
    is_at_border = np.repeat([False, False, True], 101)
    sides = sides_in_two_views(AHEAD, outline, is_at_border)
    assert sides.truncated[0].tolist() == [False, truncated]
