"""A result in three dimensions: targets of a click, the glTF file, the image, the command."""

from __future__ import annotations

import io
import itertools
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import trimesh

from estimator.records.scene import Camera, Scene, View
from estimator.views import raster
from estimator.views.glb import FACES, glb_bytes
from estimator.views.raster import render_view
from estimator.views.scene_view import COLOURS, SceneView, box_on_ray, scene_view
from estimator.views.window import report_text
from metric_cli.estimate_scale.estimate import main
from tests.support.views import hand_view

ROOM = Path(__file__).resolve().parents[3] / "data" / "scenes" / "demo_room"


@pytest.mark.parametrize(
    ("origin", "direction", "name"),
    [
        ((0, 0, 9), (0, 0, -1), "a"),
        ((0, 0, -9), (0, 0, 1), "b"),
        ((5.4, 0.4, 9), (0, 0, -2), "c"),
        ((2, 0, 9), (0, 0, -1), None),
        ((0, 0, 9), (0, 0, 1), None),
        ((0, 5, -3), (0, -1, 0), "b"),
    ],
)
def test_a_click_meets_the_nearest_box(origin, direction, name):
    met = box_on_ray(hand_view(), np.array(origin, dtype=float), np.array(direction, dtype=float))
    assert (met and met.id) == name
    assert ("weight 0.9" in report_text(met)) == (name is not None)


def test_what_is_said_of_an_outlier():
    assert report_text(hand_view().boxes[2]).endswith("outlier, weight 0.9: too small by half")


def test_the_file_is_gltf_with_a_node_for_each_box():
    data = glb_bytes(hand_view())
    assert data == glb_bytes(hand_view())
    scene = trimesh.load(io.BytesIO(data), file_type="glb")
    boxes = [mesh for mesh in scene.geometry.values() if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces) == 12]
    assert len(boxes) == 3
    for mesh in boxes:
        mesh.merge_vertices()
    assert all(mesh.is_watertight and mesh.volume == pytest.approx(1) for mesh in boxes)
    clouds = [mesh for mesh in scene.geometry.values() if isinstance(mesh, trimesh.PointCloud)]
    assert [len(cloud.vertices) for cloud in clouds] == [200]
    record = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    said = {node["name"]: node["extras"] for node in record["nodes"] if "extras" in node}
    assert said["box c"]["reason"] == "too small by half"
    assert record["buffers"][0]["byteLength"] == sum(part["byteLength"] for part in record["bufferViews"])


def test_faces_look_outward():
    ends = hand_view().boxes[0].corners[FACES]
    normals = np.cross(ends[:, 1] - ends[:, 0], ends[:, 2] - ends[:, 0])
    assert (np.einsum("ij,ij->i", normals, ends.mean(axis=1)) > 0).all()


def test_the_picture_has_all_of_the_view():
    picture = render_view(hand_view(), 600, 400)
    assert picture.shape == (400, 600, 3)
    for name in ("used", "outlier", "camera", "up"):
        assert (np.abs(picture.astype(int) - COLOURS[name]).max(axis=2) < 12).sum() > 15, name


def test_the_command_writes_both_without_a_display(tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    picture, model = tmp_path / "view.png", tmp_path / "view.glb"
    assert main([str(ROOM), "--quiet", "--view-png", str(picture), "--view-glb", str(model)]) == 0
    assert cv2.imread(str(picture)).shape == (1000, 1600, 3)
    assert len(trimesh.load(model).geometry) > 20
    record = json.loads(model.read_bytes()[20 : 20 + int.from_bytes(model.read_bytes()[12:16], "little")])
    couch = next(node["extras"] for node in record["nodes"] if node.get("extras", {}).get("category") == "couch")
    assert couch["sizes"][2].startswith("h 1.")
    assert main([str(ROOM), "--view-glb", str(tmp_path / "view.gltf")]) == 2


def test_two_per_cent_of_the_points_at_each_end_are_outside_of_the_bounds() -> None:
    points = np.repeat(np.arange(101.0)[:, None], 3, axis=1)
    view = SceneView(
        points, np.zeros((101, 3), dtype=int), np.zeros((0, 2, 3)), (), (), np.zeros((0, 2, 3)), "m", "resolved"
    )
    assert view.bounds() == pytest.approx(np.array([[2.0] * 3, [98.0] * 3]))


def test_cameras_and_the_vertical_are_drawn_relative_to_the_diagonal_of_the_scene() -> None:
    """The diagonal is that of the points without 2 % at each end: 4 % for a camera, 25 % for the vertical."""
    points = np.repeat(np.arange(101.0)[:, None], 3, axis=1)
    camera = Camera("PINHOLE", 200, 200, np.array([100.0, 100.0, 100.0, 100.0]))
    view = View("a", camera, np.eye(3), np.full(3, -50.0), np.empty((0, 2)), np.empty(0, dtype=np.int64))
    result = SimpleNamespace(best_scale=None, up=None, objects=(), scale=None, interval=None, status="unresolved")
    scene = Scene(Path(), "memory", (view,), points)
    drawn = scene_view(SimpleNamespace(result=result, scene=scene, measurements=None))  # type: ignore[arg-type]
    diagonal = 96 * np.sqrt(3)
    edge = drawn.cameras[0, 1] - drawn.cameras[0, 0]
    assert np.linalg.norm(edge) == pytest.approx(0.04 * diagonal * np.sqrt(3))
    assert np.linalg.norm(drawn.up[0, 1] - drawn.up[0, 0]) == pytest.approx(0.25 * diagonal)


@pytest.mark.parametrize(
    ("node", "tier", "category"),
    [("chair.n.01", "measured", "chair.n.01 (measured)"), (None, None, "not known (no size)")],
)
def test_the_report_of_a_box(node: str | None, tier: str | None, category: str) -> None:
    box = hand_view().boxes[0]
    box = replace(box, report={**box.report, "node": node, "tier": tier})
    lines = ["chair a", f"category: {category}", "h 1.00", "used, weight 0.9"]
    assert report_text(box) == "\n".join(lines)


@pytest.mark.parametrize("n_lines", [1, 4])
def test_labels_of_one_place_do_not_overlap(monkeypatch: pytest.MonkeyPatch, n_lines: int) -> None:
    drawn: list[list[float]] = []
    monkeypatch.setattr("PIL.ImageDraw.ImageDraw.rectangle", lambda _, place, *__: drawn.append(place))
    box = replace(hand_view().boxes[0], title="a", sizes="b\n" * n_lines)
    canvas = np.zeros((900, 600, 3), dtype=np.uint8)
    raster.with_labels(canvas, hand_view(), [(box, np.full((8, 2), 300.0))] * 3, np.zeros(2))
    for (left, top, right, bottom), (x0, y0, x1, y1) in itertools.combinations(drawn, 2):
        assert right <= x0 or x1 <= left or bottom <= y0 or y1 <= top


EMPTY = {
    "points": (np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)),
    "cameras": np.zeros((0, 2, 3)),
    "up": np.zeros((0, 2, 3)),
    "planes": (),
    "boxes": (),
}


@pytest.mark.parametrize("part", ["points", "cameras", "up", "planes", "boxes"])
def test_a_view_without_a_part_has_no_node_of_it(part: str) -> None:
    changes = (
        {"points": EMPTY["points"][0], "point_colours": EMPTY["points"][1]} if part == "points" else {part: EMPTY[part]}
    )
    names = {}
    for key, view in (("all", hand_view()), ("without", replace(hand_view(), **changes))):
        data = glb_bytes(view)
        record = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
        names[key] = [node["name"] for node in record["nodes"]]
        assert record["scenes"][0]["nodes"] == list(range(len(record["nodes"])))
    omitted = {"planes": {"plane 1"}, "boxes": {"box a", "box b", "box c"}}.get(part, {part})
    assert [name for name in names["all"] if name not in omitted] == names["without"]


def test_a_view_of_cameras_only_has_their_bounds() -> None:
    view = replace(hand_view(), points=EMPTY["points"][0], point_colours=EMPTY["points"][1], boxes=(), planes=())
    assert view.bounds() == pytest.approx(np.array([[-1, 1, 3], [1, 1.8, 4]]))
    nothing = replace(view, cameras=EMPTY["cameras"])
    assert nothing.bounds() == pytest.approx(np.array([[-1.0] * 3, [1.0] * 3]))


@pytest.mark.parametrize("verdict", ["used", "outlier"])
def test_faces_are_transparent_and_edges_are_not(verdict: str) -> None:
    data = glb_bytes(replace(hand_view(), boxes=tuple(b for b in hand_view().boxes if b.verdict == verdict)[:1]))
    record = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    node = next(node for node in record["nodes"] if node["name"].startswith("box"))
    edges, faces = record["meshes"][node["mesh"]]["primitives"]
    assert (edges["mode"], faces["mode"]) == (1, 4)
    materials = [record["materials"][primitive["material"]] for primitive in (edges, faces)]
    assert [material.get("alphaMode") for material in materials] == [None, "BLEND"]
    assert [material["pbrMetallicRoughness"]["baseColorFactor"][3] for material in materials] == [1.0, 0.16]
