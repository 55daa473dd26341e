"""A reconstruction that contradicts its observations has a warning; a consistent one has none."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import metric_tree
from estimator import estimate_scale
from estimator.reconstructions.model_checks import (
    MAX_ASSUMED_HEIGHT_M,
    MAX_USUAL_HEIGHT_M,
    ReprojectionStatistics,
    focal_problem,
    implied_position_problem,
    reprojection_problems,
    reprojection_statistics,
)
from estimator.records.objects import SupportPlane
from estimator.records.result import ResultContext
from estimator.records.scene import SceneProblem, camera_centres
from estimator.results import estimate
from estimator.results.estimate import scale_of_objects
from tests.synthetic.evidence import objects_of
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.shapes import box, floor, orbit, synthetic_scene


@pytest.fixture(scope="module")
def good():
    objects = [floor(4), box("cabinet", (0.6, 0.4, 0.8), (0, 0, 0))]
    return synthetic_scene(objects, orbit(5, 2.5, 1.4, size=(200, 150), focal=160.0), dense=100, sparse=400).scene


@pytest.fixture(scope="module")
def good_scene():
    objects = [floor(4), box("chair", (0.6, 0.4, 0.8), (0, 0, 0))]
    synthetic = synthetic_scene(objects, orbit(5, 2.5, 1.4, size=(200, 150), focal=160.0), dense=400, sparse=400)
    return synthetic.scene, synthetic.instances


@pytest.fixture(scope="module")
def room():
    return quick_scene(furnished_room(next(iter(KINDS)), 40), seed=40, dense_a_frame=0)


def shaken(scene, pixels):
    """The scene with keypoints that are off by a normal error of so many pixels in x and y."""
    random = np.random.default_rng(0)
    views = [replace(v, keypoints=v.keypoints + random.normal(0, pixels, v.keypoints.shape)) for v in scene.views]
    return replace(scene, views=tuple(views))


def test_a_good_scene_is_consistent(good):
    measures = reprojection_statistics(good)
    assert measures.median_relative < 0.004
    assert measures.behind == 0
    assert 1 < measures.depth_ratio < 20
    assert reprojection_problems(measures) == ()


def test_the_median_error_is_that_of_the_keypoints(good):
    """The distance of a normal error in two dimensions has the median 1.177 sigma."""
    measures = reprojection_statistics(shaken(good, 10.0))
    assert measures.median_px == pytest.approx(11.77, rel=0.1)
    assert measures.median_relative == pytest.approx(measures.median_px / 200)


@pytest.mark.parametrize(("pixels", "doubts", "errors"), [(1.5, 1, 0), (10.0, 0, 1)])
def test_keypoints_that_miss_are_doubted_and_then_rule_the_model_out(good, pixels, doubts, errors):
    problems = reprojection_problems(reprojection_statistics(shaken(good, pixels)))
    assert [problem.is_fatal for problem in problems] == [False] * doubts + [True] * errors


def test_points_behind_the_cameras_rule_the_model_out(good):
    about = np.array([-1.0, 1.0, -1.0])
    turned = tuple(
        replace(v, rotation=about[:, None] * v.rotation, translation=about * v.translation) for v in good.views
    )
    measures = reprojection_statistics(replace(good, views=turned))
    assert measures.behind == 1
    assert any("behind" in problem.message and problem.is_fatal for problem in reprojection_problems(measures))


def test_depths_of_many_orders_are_doubted(good):
    centre = good.views[0].centre
    reach = np.geomspace(1, 1e5, len(good.points))[:, None]
    far = replace(good, points=centre + (good.points - centre) * reach)
    measures = reprojection_statistics(replace(far, views=far.views[:1]))
    assert any("factor" in problem.message and not problem.is_fatal for problem in reprojection_problems(measures))


def test_without_observations_nothing_is_said(good):
    nothing = {"keypoints": np.empty((0, 2)), "point_index": np.empty(0, dtype=np.int64)}
    measures = reprojection_statistics(replace(good, views=tuple(replace(v, **nothing) for v in good.views)))
    assert np.isnan(measures.median_px)
    assert reprojection_problems(measures) == ()


def test_parts_that_do_not_fit_rule_the_model_out(good):
    """A third of the points is moved aside: the median error stays small."""
    moved = good.points + np.where(np.arange(len(good.points)) % 3 == 0, 0.5, 0.0)[:, None]
    measures = reprojection_statistics(replace(good, points=moved))
    assert measures.median_relative < 0.004
    assert measures.misses > 0.1
    assert any("do not fit" in problem.message and problem.is_fatal for problem in reprojection_problems(measures))


@pytest.mark.filterwarnings("error")
def test_a_scene_that_is_ruled_out_prints_no_warnings_of_numpy(good_scene, mini):
    """A scene in units of 1e300: its points are at one place as far as numbers go."""
    scene, instances = good_scene
    views = tuple(replace(v, translation=v.translation * 1e-300) for v in scene.views)
    tiny = replace(scene, points=scene.points * 1e-300, views=views, dense=None)
    result = estimate_scale(tiny, instances, mini)
    assert result.status == "unresolved"


@pytest.mark.parametrize(("n_apart", "n_groups"), [(1, 1), (2, 2)])
def test_groups_of_views_without_a_common_point_are_doubted(good, n_apart, n_groups):
    """A single view is no group."""
    assert reprojection_statistics(good).groups == 1
    half = len(good.points) // 2
    views = []
    for number, view in enumerate(good.views):
        own = (view.point_index < half) == (number < n_apart)
        views.append(replace(view, keypoints=view.keypoints[own], point_index=view.point_index[own]))
    parted = reprojection_statistics(replace(good, views=tuple(views)))
    assert parted.groups == n_groups
    problems = [problem for problem in reprojection_problems(parted) if "2 groups" in problem.message]
    assert [problem.is_fatal for problem in problems] == [False] * (n_groups - 1)


@pytest.mark.parametrize(
    ("factor", "fraction", "status"),
    [
        pytest.param(1.0, 0.5, "resolved", id="the same scale"),
        pytest.param(2.0, 0.5, "unresolved", id="twice the scale"),
        pytest.param(2.0, 0.11, "unresolved", id="more than a tenth of the views"),
        pytest.param(2.0, 0.09, "resolved", id="less than a tenth of the views"),
    ],
)
def test_two_models_in_one_scene_need_the_same_scale(room, factor: float, fraction: float, status: str) -> None:
    """The last `fraction` of the views is a separate model, `factor` times as large."""
    n, first = len(room.scene.points), round((1 - fraction) * len(room.scene.views))
    views = [
        replace(
            view, translation=view.translation * (1 if number < first else factor), point_index=view.point_index + n
        )
        if number >= first
        else view
        for number, view in enumerate(room.scene.views)
    ]
    points = np.vstack([room.scene.points, factor * room.scene.points])
    instances = [replace(one, track=None) for one in room.instances]
    result = estimate_scale(replace(room.scene, views=tuple(views), points=points, dense=None), instances)
    assert result.status == status
    if status == "unresolved":
        assert result.scale is None
        assert any("different or unknown scales" in line for line in result.warnings)
    else:
        assert result.scale == pytest.approx(room.truth.metres_per_unit, rel=0.15)


@pytest.mark.parametrize(
    ("metres", "is_plausible"), [(0.09, False), (0.11, True), (3.0, True), (990.0, True), (1010.0, False)]
)
def test_a_scale_implies_the_distance_of_the_cameras(good, metres: float, is_plausible: bool) -> None:
    depths = [np.median(view.to_camera(good.points[view.point_index])[:, 2]) for view in good.views]
    problem = implied_position_problem(good, metres / float(np.median(depths)), None)
    assert (problem is None) == is_plausible


@pytest.mark.parametrize(
    ("metres", "elevation_deg", "limit", "is_plausible", "is_doubtful"),
    [
        (9.9, 0.0, MAX_USUAL_HEIGHT_M, True, False),
        (10.1, 0.0, MAX_USUAL_HEIGHT_M, False, False),
        (3.9, 0.0, MAX_ASSUMED_HEIGHT_M, True, False),
        (4.1, 0.0, MAX_ASSUMED_HEIGHT_M, False, False),
        (49.0, 0.0, MAX_USUAL_HEIGHT_M, False, False),
        (51.0, 0.0, MAX_USUAL_HEIGHT_M, False, True),
        (51.0, -29.0, MAX_USUAL_HEIGHT_M, False, True),
        (51.0, -31.0, MAX_USUAL_HEIGHT_M, True, False),
        (0.11, 0.0, MAX_USUAL_HEIGHT_M, True, False),
        (0.09, 0.0, MAX_USUAL_HEIGHT_M, False, True),
    ],
)
def test_level_cameras_are_at_a_usual_height_above_the_floor(
    good, metres: float, elevation_deg: float, limit: float, is_plausible: bool, is_doubtful: bool
) -> None:
    """Two units above a floor, whose vertical is `elevation_deg` from a right angle with the optical axes."""
    axis = good.views[0].rotation[2]
    level = np.cross(axis, [0.3, 0.5, 0.8])
    angle = np.radians(elevation_deg)
    up = np.cos(angle) * level / np.linalg.norm(level) + np.sin(angle) * axis
    views = tuple(replace(view, rotation=good.views[0].rotation) for view in good.views)
    height = float(np.median(camera_centres(views) @ up)) - 2
    floor = SupportPlane(np.stack([axis, axis, up]), height, 0.01, 100, np.zeros(2), 1.0, np.ones((1, 1), dtype=bool))
    depths = [np.median(view.to_camera(good.points[view.point_index])[:, 2]) for view in views]
    assert 1.2 < np.median(depths) / 2 < 20  # the distances are usual
    problem = implied_position_problem(replace(good, views=views), metres / 2, floor, limit)
    assert (problem is None) == is_plausible
    assert problem is None or problem.is_doubtful == is_doubtful


@pytest.mark.parametrize(
    ("ratio", "model", "is_doubtful"),
    [
        (1 / 1.35, "SIMPLE_PINHOLE", True),
        (1 / 1.25, "SIMPLE_PINHOLE", False),
        (1.25, "SIMPLE_PINHOLE", False),
        (1.35, "SIMPLE_PINHOLE", True),
        (1.35, "SIMPLE_RADIAL_FISHEYE", False),
    ],
)
def test_a_focal_length_that_contradicts_exif_makes_the_scale_uncertain(
    good, tmp_path, ratio: float, model: str, is_doubtful: bool
) -> None:
    """EXIF states 34.6 mm, which is 160 pixels in images of 200 x 150 pixels; the images have half of this size."""
    (tmp_path / "images").mkdir()
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 160 / 250 * 43.2666
    views = []
    for view in good.views:
        Image.new("L", (100, 75)).save(tmp_path / "images" / f"{view.name}.jpg", exif=exif)
        params = np.array([160.0 * ratio, 100.0, 75.0])
        camera = replace(view.camera, model=model, params=params)
        views.append(replace(view, name=f"{view.name}.jpg", camera=camera))
    assert focal_problem(replace(good, views=tuple(views))) is None  # no images in or above the folder
    problem = focal_problem(replace(good, views=tuple(views), path=tmp_path))
    assert (problem is not None) == is_doubtful
    if problem is not None:
        assert problem.is_doubtful
        assert f"{ratio:.2f} times that of EXIF" in problem.message


def test_a_doubtful_problem_makes_a_resolved_scale_uncertain() -> None:
    tree = metric_tree.open()
    objects = objects_of(tree, ["chair", "sofa", "coffee table", "refrigerator", "bottle", "television"], 0.5)
    assert scale_of_objects(objects, tree).status == "resolved"
    context = ResultContext(problems=(SceneProblem("depths are wrong", is_doubtful=True),))
    result = scale_of_objects(objects, tree, context=context)
    assert (result.status, result.warnings[0]) == ("uncertain", "uncertain: depths are wrong")
    assert result.scale == scale_of_objects(objects, tree).scale


def test_curves_for_the_figure_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    """The curves of 50,000 objects would take 2 GB."""
    tree = metric_tree.open()
    objects = objects_of(tree, ["chair", "sofa", "coffee table"], 0.5)
    assert len(scale_of_objects(objects, tree).object_curves) == 3
    monkeypatch.setattr(estimate, "MAX_CURVES", 2)
    result = scale_of_objects(objects, tree)
    assert len(result.object_curves) == 2
    assert len(result.objects) == 3


GOOD = ReprojectionStatistics(0.3, 3e-4, 0.0, 0.0, 5.0, 1)


@pytest.mark.parametrize(
    ("field", "accepted", "doubtful", "wrong"),
    [
        ("median_relative", 0.0039, 0.0041, 0.0201),
        ("misses", 0.019, 0.021, 0.101),
        ("behind", 0.019, 0.021, 0.201),
        ("depth_ratio", 299.0, 301.0, None),
        ("groups", 1, 2, None),
    ],
)
def test_every_measure_has_a_warning_and_an_error(
    field: str, accepted: float, doubtful: float, wrong: float | None
) -> None:
    """Values close to the thresholds, on both sides."""
    assert reprojection_problems(replace(GOOD, **{field: accepted})) == ()
    (warning,) = reprojection_problems(replace(GOOD, **{field: doubtful}))
    assert not warning.is_fatal
    if wrong is not None:
        (error,) = reprojection_problems(replace(GOOD, **{field: wrong}))
        assert error.is_fatal
