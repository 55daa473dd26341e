"""The baselines follow the paper and its predecessor, including their errors."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import multivariate_normal
from sklearn.mixture import BayesianGaussianMixture
from threadpoolctl import threadpool_limits

import metric_tree
from estimator.baselines import paper
from estimator.baselines.candidate_search import CANDIDATES, candidate_scales, estimate_on
from estimator.baselines.paper import PaperMixture, authors_lists, fit_mixture, paper_result
from estimator.baselines.sucar import box_heights, prescribed_down, sucar_result
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.scene import Camera, Instance, Scene, View
from metric_base.errors import InputError
from metric_cli.estimate_scale.estimate import main
from metric_tree.node import Node
from metric_tree.prior import Prior
from metric_tree.tree import Tree


def _object(name: str, category: str, extents: tuple[float, ...], eta: tuple[float, ...] = (1, 1, 1)) -> MeasuredObject:
    return MeasuredObject(name, category, np.array(extents), np.full(3, 0.03), np.array(eta, dtype=float))


def test_product_without_jacobian_is_low() -> None:
    """Methods.md: the estimate is low by c^2 / (1 + c^2) for a class of relative spread c, however many objects."""
    generator = np.random.default_rng(0)
    spread = 0.3
    sizes = generator.normal(1000, spread * 1000, 4000)
    heights = sizes[sizes > 100] / 1000  # at scale one
    mixture = PaperMixture(("height",), np.ones(1), np.array([[1000.0]]), np.array([[[(spread * 1000) ** 2]]]))
    scales = np.linspace(0.5, 1.5, 1001)
    product = np.stack([mixture.log_density(scales[:, None] * height * 1000, [0]) for height in heights[:600]])
    found = estimate_on(scales, product, 0.9)
    assert found.modes[0].scale == pytest.approx(1 - spread**2 / (1 + spread**2), abs=0.02)


@pytest.mark.parametrize("size_mm", [0.5, 400.0, 5e4])
@pytest.mark.parametrize("shape", [(9, 3), (1, 3), (12, 1), (2, 2)])
def test_items_of_one_size_have_a_mixture_with_a_spread(size_mm: float, shape: tuple[int, int]) -> None:
    mixture = fit_mixture(("length", "width", "height")[: shape[1]], np.full(shape, size_mm))
    deviations = np.sqrt(np.einsum("kii->ki", mixture.covariances)) / size_mm
    assert ((deviations > 0.005) & (deviations < 0.02)).all()
    assert mixture.means == pytest.approx(size_mm)


#: Categories of the release with items of one size along an axis, the first ones by name.
ONE_SIZE = (
    "backboard.n.01", "balance_beam.n.01", "barbell.n.01", "baseball.n.02", "bowling_ball.n.01", "bowling_pin.n.01",
    "car_battery.n.01", "card.n.02", "cassette_tape.n.01", "compact_disk.n.01", "countertop.n.01", "credit_card.n.01",
)  # fmt: skip


def _has_spread(mixture: PaperMixture) -> bool:
    """Return whether every covariance is valid, with standard deviations above 0.1 % of the smallest mean."""
    deviations = np.sqrt(np.einsum("kii->ki", mixture.covariances))
    is_valid = (np.linalg.eigvalsh(mixture.covariances) > 0).all()
    return bool(is_valid and (deviations > 0.001 * mixture.means.min()).all())


def test_categories_of_one_size_have_a_mixture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of nine items each to save time."""
    monkeypatch.setattr(paper, "MAX_ITEMS", 9)
    tree = metric_tree.open()
    for name in ONE_SIZE:
        node = tree.node(name)
        mixture, _ = paper.node_mixture.__wrapped__(node, node.prior().dims)  # without the cache
        assert _has_spread(mixture), name


@pytest.mark.parametrize(("n_items", "n_components"), [(149, 49), (150, 50), (154, 50)])
def test_a_mixture_of_the_paper_has_a_component_per_three_of_at_most_150_items(
    n_items: int, n_components: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sklearn.mixture.BayesianGaussianMixture", partial(BayesianGaussianMixture, max_iter=1))
    sizes = np.exp(np.random.default_rng(0).normal(6.0, 0.3, (n_items, 2)))
    assert len(paper.fit_mixture(("length", "width"), sizes).weights) == n_components


N_PARTS = 4


@pytest.fixture(scope="module")
def items_by_node() -> tuple[pa.Table, dict[str, list[int]]]:
    """Return the sizes of all items, read once, and their rows by node."""
    columns = ["extents_mm", "length_mm", "width_mm", "height_mm"]
    table = metric_tree.open().release.table("items", columns=["node_id", *columns])
    rows = defaultdict[str, list[int]](list)
    for row, name in enumerate(table.column("node_id").to_pylist()):
        rows[name].append(row)
    return table, rows


@pytest.mark.slow
@pytest.mark.parametrize("part", range(N_PARTS))
def test_every_category_with_a_prior_has_a_mixture(
    part: int, items_by_node: tuple[pa.Table, dict[str, list[int]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of nine items and one iteration each, because the initial covariances are those that can be ill-defined."""
    table, rows = items_by_node

    def items(node: Node) -> pa.Table:
        used = [row for one in node.descendants() for row in rows.get(one.node_id, [])]
        return table.take(np.array(used, dtype=np.int64))

    monkeypatch.setattr(paper, "MAX_ITEMS", 9)
    monkeypatch.setattr(Node, "items", items)
    monkeypatch.setattr("sklearn.mixture.BayesianGaussianMixture", partial(BayesianGaussianMixture, max_iter=1))
    tree = metric_tree.open()
    names = sorted(set(tree.release.table("priors", columns=["node_id"]).column("node_id").to_pylist()))
    assert set(ONE_SIZE) < set(names)
    with threadpool_limits(1):  # threads of BLAS cost more than the matrices of 3 x 3
        for name in names[part::N_PARTS]:
            node = tree.node(name)
            mixture, _ = paper.node_mixture.__wrapped__(node, node.prior().dims)
            assert _has_spread(mixture), name


@pytest.mark.parametrize(("spread", "is_changed"), [(0.009, True), (0.011, False)])
def test_only_an_axis_without_spread_has_a_minimum(spread: float, is_changed: bool) -> None:
    generator = np.random.default_rng(0)
    height = 50 * (1 + spread * np.where(np.arange(30) % 2, 1, -1))
    sizes = np.column_stack([generator.normal(400, 30, 30), height])
    model = BayesianGaussianMixture(n_components=10, random_state=0).fit(sizes)
    equal = np.array_equal(fit_mixture(("length", "height"), sizes).covariances, model.covariances_)
    assert equal == (not is_changed)


def test_mixture_density_is_scikit_learns() -> None:
    generator = np.random.default_rng(1)
    sizes = generator.normal([500, 400, 900], [50, 40, 60], (60, 3))
    mixture = fit_mixture(("length", "width", "height"), sizes)
    assert len(mixture.weights) == 20  # n // 3
    points = generator.normal([500, 400, 900], 60, (5, 3))
    expected = np.log(
        sum(
            w * multivariate_normal(m, c).pdf(points)
            for w, m, c in zip(mixture.weights, mixture.means, mixture.covariances, strict=True)
        )
    )
    assert mixture.log_density(points, [0, 1, 2]) == pytest.approx(expected, rel=1e-6)
    marginal = np.log(
        sum(
            w * multivariate_normal(m[[0, 2]], c[np.ix_([0, 2], [0, 2])]).pdf(points[:, [0, 2]])
            for w, m, c in zip(mixture.weights, mixture.means, mixture.covariances, strict=True)
        )
    )
    assert mixture.log_density(points[:, [0, 2]], [0, 2]) == pytest.approx(marginal, rel=1e-6)


def test_candidates_hold_every_proposal() -> None:
    scales = candidate_scales(np.array([0.2, 0.5]))
    assert len(scales) == CANDIDATES
    assert scales[0] < 0.2
    assert scales[-1] > 0.5
    assert np.allclose(np.diff(scales), scales[1] - scales[0])


def test_paper_drops_implausible_dimensions(mini: Tree) -> None:
    objects = [
        _object("1", "swivel chair", (1.24, 1.20, 1.00), (0.9, 0.8, 0.4)),  # half a metre a unit; height half seen
        _object("2", "bar stool", (0.84, 0.80, 1.52)),
        _object("3", "bar stool", (9.0, 9.0, 9.0), (0.1, 0.1, 0.1)),
    ]
    result = paper_result(objects, mini, EstimateOptions(method="paper"))
    assert result.status == "resolved"
    assert result.scale == pytest.approx(0.5, rel=0.04)
    assert result.objects[0].used == ("length", "width")
    assert result.objects[1].used == ("length", "width", "height")
    assert result.objects[2].verdict == "skipped"
    assert "confidence" in (result.objects[2].reason or "")
    # no object can be an outlier
    assert {item.weight for item in result.objects[:2]} == {1.0}
    assert set(result.seconds) == {"fit", "posterior"}


def test_paper_without_usable_objects_is_unresolved(mini: Tree) -> None:
    result = paper_result([_object("1", "unicorn", (1, 1, 1))], mini, EstimateOptions(method="paper"))
    assert (result.status, result.scale) == ("unresolved", None)


def _lists(folder: Path) -> Path:
    folder.mkdir()
    (folder / "mouse.csv").write_text("60,110,35\n62,114,37\n64,112,36\n66,118,38\n", encoding="utf-8")
    (folder / "diningchair.csv").write_text("18,20,36\n17,19,35\n", encoding="utf-8")
    (folder / "person.csv").write_text("1700\n1800\n", encoding="utf-8")
    return folder


def test_authors_lists(tmp_path: Path, mini: Tree) -> None:
    """The axes of the files: sorted sides, height last; categories that are not in the tree are skipped."""
    lists = authors_lists(_lists(tmp_path / "lists"), mini)
    assert set(lists) <= {node.node_id for node in mini}
    for dims, sizes in lists.values():
        assert sizes.shape[1] == len(dims)
        if dims[:2] == ("length", "width"):
            assert (sizes[:, 0] >= sizes[:, 1]).all()


def test_authors_lists_missing(tmp_path: Path, mini: Tree) -> None:
    with pytest.raises(InputError, match="--paper-lists"):
        authors_lists(tmp_path / "nowhere", mini)


def _scene(height: float = 0.8, tilt: float = 0.0) -> tuple[Scene, Instance]:
    """A stick of a height (scene units) four units before a camera that leans by `tilt`, its detection box."""
    camera = Camera("PINHOLE", 640, 480, np.array([500.0, 500.0, 320.0, 240.0]))
    c, s = math.cos(tilt), math.sin(tilt)
    rotation = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    points = np.column_stack([np.zeros(9), np.linspace(-height / 2, height / 2, 9), np.full(9, 4.0)])
    seen = points @ rotation.T
    pixels = seen[:, :2] / seen[:, 2:] * 500 + [320, 240]
    views = (
        View("first.png", camera, np.eye(3), np.zeros(3), np.zeros((0, 2)), np.zeros(0, dtype=np.int64)),
        View("second.png", camera, rotation, np.zeros(3), pixels, np.arange(9)),
    )
    top, bottom = round(float(pixels[:, 1].min())), round(float(pixels[:, 1].max()))
    mask = np.ones((bottom - top, 20), dtype=bool)
    scene = Scene(Path("made"), "memory", views, points)
    return scene, Instance("1", 1, "bar stool", mask, (310, top))


@pytest.mark.parametrize("tilt", [0.0, 0.3, -0.2])
def test_box_height_follows_the_prescribed_vertical(tilt: float) -> None:
    scene, instance = _scene(tilt=tilt)
    down = prescribed_down(scene)
    assert down.tolist() == [0, 1, 0]
    assert box_heights(scene, [instance], down)[0] == pytest.approx(0.8, rel=0.02)


def test_box_without_points_has_no_height() -> None:
    scene, instance = _scene()
    away = replace(instance, origin=(0, 0), mask=np.ones((5, 5), dtype=bool))
    assert math.isnan(box_heights(scene, [away], prescribed_down(scene))[0])


def test_sucar_counts_every_frame(mini: Tree) -> None:
    """A bar stool of 760 mm that is 0.8 units high: the scale is 0.95, and each further frame narrows the interval."""
    scene, instance = _scene()
    one = sucar_result(scene, [instance], mini, EstimateOptions(method="sucar"))
    assert one.scale == pytest.approx(0.95, rel=0.03)
    many = sucar_result(scene, [instance] * 9, mini, EstimateOptions(method="sucar"))
    assert one.interval is not None
    assert many.interval is not None
    narrowed = math.log(one.interval.high / one.interval.low) / math.log(many.interval.high / many.interval.low)
    assert narrowed == pytest.approx(3, rel=0.15)
    assert all(item.used == ("height",) for item in many.objects)


def test_height_is_ours_with_heights_alone(tmp_path: Path, mini: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "objects.json"
    document = {
        "schema": "metric-tree/objects/1",
        "objects": [
            {"category": "bar stool", "dimensions": {"length": 90.0, "width": 80.0, "height": height}}
            for height in (1.50, 1.52, 1.54)
        ],
    }
    path.write_text(json.dumps(document), encoding="utf-8")
    status = main(["--objects", str(path), "--tree", str(mini.release.directory), "--method", "height", "--json"])
    record = json.loads(capsys.readouterr().out)
    assert status == 0
    assert record["scale"] == pytest.approx(0.5, rel=0.03)
    assert record["objects"][0]["used"] == ["height"]


def test_the_baselines_have_no_jacobian(mini: Tree, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one object the highest likelihood is the mean size over the measured one, however wide the class is."""
    monkeypatch.setattr(Prior, "sample", lambda *_: np.array([[700.0], [1300.0]]))  # mean 1000, deviation 300
    scene, instance = _scene(height=0.8)
    by_box = sucar_result(scene, [instance], mini, EstimateOptions(method="sucar"))
    assert by_box.modes[0].scale == pytest.approx(1.25, rel=0.01)
    wide = PaperMixture(("height",), np.ones(1), np.array([[1000.0]]), np.array([[[300.0**2]]]))
    monkeypatch.setattr(paper, "node_mixture", lambda *_: (wide, False))
    by_paper = paper_result([_object("1", "bar stool", (0.5, 0.5, 0.8))], mini, EstimateOptions(method="paper"))
    assert by_paper.modes[0].scale == pytest.approx(1.25, rel=0.01)


@pytest.mark.parametrize(("eta", "names"), [(0.71, ("length", "width", "height")), (0.69, ("length", "width"))])
def test_a_dimension_has_a_confidence_of_70_percent(eta: float, names: tuple[str, ...]) -> None:
    mixture = PaperMixture(("length", "width", "height"), np.ones(1), np.ones((1, 3)), np.eye(3)[None])
    assert paper.plausible_dimensions(_object("a", "desk", (1.0, 0.5, 0.7), (1, 1, eta)), mixture)[0] == names


@pytest.mark.parametrize(("n_items", "n_fitted"), [(8, 150), (9, 9)])
@pytest.mark.parametrize("dims", [("height",), ("extent1",)])
def test_a_class_of_fewer_than_nine_items_is_sampled_from_its_prior(
    dims: tuple[str, ...], n_items: int, n_fitted: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MIN_ITEMS of those that have every dimension; the last one has none."""
    heights = [*np.linspace(700.0, 900.0, n_items), math.nan]
    extents = [[3.0, 2.0, height] for height in heights[:-1]] + [None]
    prior = SimpleNamespace(sample=lambda count, _: np.full((count, 1), 800.0))
    node: Any = SimpleNamespace(
        items=lambda: pa.table({"height_mm": heights, "extents_mm": extents}), prior=lambda _: prior
    )
    fitted: list[int] = []
    monkeypatch.setattr(paper, "fit_mixture", lambda _, sizes: fitted.append(len(sizes)))
    _, is_sampled = paper.node_mixture.__wrapped__(node, dims)
    assert fitted == [n_fitted]
    assert is_sampled == (n_items < 9)
