"""What readers of models accept beside the usual, and what they refuse, by small files written by hand."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import metric_tree
from metric_base.errors import InputError
from models3d.asset import Asset, AssetBody
from models3d.formats import read_asset
from models3d.gltf.animation import Channel
from models3d.gltf.document import GltfWriter
from models3d.gltf.model_reader import read_model
from models3d.size_check.check import check_bodies
from models3d.size_check.true_size import boxes_true_size
from tests.models3d.models import CHAIR

TREE = metric_tree.open()
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


@pytest.mark.parametrize("degrees", [0.0, 2.0, 3.5, 60.0])
@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_a_rotation_is_uniform(degrees: float, share: float) -> None:
    half = np.radians(degrees / 2)
    keys = np.array([[0.0, 0, 0, 1], [0, np.sin(half), 0, np.cos(half)]])
    x, y, z, w = Channel(0, "rotation", "LINEAR", np.array([0.0, 2.0]), keys).at(2 * share)
    assert (x, z) == (0, 0)
    assert np.degrees(2 * np.arctan2(y, w)) == pytest.approx(share * degrees, abs=1e-4)


@pytest.mark.parametrize(("kind", "value"), [("LINEAR", 2.5), ("STEP", 1.0), ("CUBICSPLINE", 2.5)])
def test_an_animation_is_constant_outside_its_keys(kind: str, value: float) -> None:
    keys = np.array([[1.0], [4.0]])
    values = np.stack([np.zeros((2, 1)), keys, np.zeros((2, 1))], axis=1) if kind == "CUBICSPLINE" else keys
    channel = Channel(0, "translation", kind, np.array([1.0, 3.0]), values)
    assert [float(channel.at(time)[0]) for time in (0.0, 1.0, 2.0, 3.0, 9.0)] == [1, 1, value, 4, 4]


def _mesh(file: Path, attributes: dict[str, Any] | None = None, nodes: int = 1, **fields: Any) -> Path:
    document = GltfWriter("test")
    own = {"POSITION": document.add_accessor(SQUARE)} if attributes is None else attributes
    document.add("meshes", {"primitives": [{"attributes": own} | fields]})
    roots = [document.add("nodes", {"mesh": 0} if k == 0 else {"name": "lamp"}) for k in range(nodes)]
    file.write_bytes(document.to_bytes(roots))
    return file


@pytest.mark.parametrize(("mode", "area"), [(5, 0.0), (6, 1.0)])
def test_the_triangles_of_a_strip_and_of_a_fan(mode: int, area: float, tmp_path: Path) -> None:
    """The corners of a square in their order: a fan fills it, the triangles of a strip look opposite ways."""
    (mesh,) = read_model(_mesh(tmp_path / "a.glb", mode=mode)).meshes
    first, second, third = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    assert np.linalg.norm(np.cross(second - first, third - first).sum(axis=0)) / 2 == pytest.approx(area)


def test_a_node_without_a_mesh_is_no_object(tmp_path: Path) -> None:
    assert len(read_asset(_mesh(tmp_path / "a.glb", nodes=3)).bodies) == 1


@pytest.mark.parametrize("name", ["empty.glb", "folder.stl", "none.obj"])
def test_a_model_is_a_file_with_a_shape(name: str, tmp_path: Path) -> None:
    _mesh(tmp_path / "empty.glb", attributes={})
    (tmp_path / "folder.stl").mkdir()
    found = {"empty.glb": "at least one shape, found none", "folder.stl": "a folder", "none.obj": "no such file"}
    with pytest.raises(InputError, match=found[name]):
        read_asset(tmp_path / name)


@pytest.mark.parametrize(
    ("bounds", "extents"),
    [
        ({"min": [0, 0, 0], "max": [1, 2, 3]}, [1, 2, 3]),
        ({"min": [0, 0, 0]}, None),
        ({"max": [1, 2, 3]}, None),
        ({}, None),
    ],
)
def test_compressed_vertices_have_the_box_of_their_bounds(
    bounds: dict[str, Any], extents: list[float] | None, tmp_path: Path
) -> None:
    header = {
        "asset": {"version": "2.0"},
        "accessors": [{"count": 8, "componentType": 5126, "type": "VEC3"} | bounds],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(header))
    with nullcontext() if extents else pytest.raises(InputError, match=r"accessors\[0\]"):
        assert read_asset(tmp_path / "a.gltf").bodies[0].extents_m.tolist() == extents


@pytest.mark.parametrize(("row", "is_used"), [("chair", True), ("zzqx", False)])
def test_a_table_of_boxes_needs_one_known_category(row: str, is_used: bool, tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    x, y, z = CHAIR * 1000
    table.write_text(f"name,x,y,z\n{row},{x},{z},{y}\nzzqy,1,1,1\n")
    with nullcontext() if is_used else pytest.raises(InputError, match="names of objects whose size is known"):
        size = boxes_true_size(table, TREE)
        assert size.reason == "1 of 2 objects: chair"
        assert size.factor[0] < 0.001 < size.factor[2]
    table.write_text("name,x,y,z\nchair,1,1,many\n")
    with pytest.raises(InputError, match="many"):
        boxes_true_size(table, TREE)


@pytest.mark.parametrize(("extents", "reason"), [([0.0, 0.0, 0.0], "it has no extent"), ([0.0, 1.0, 0.0], None)])
def test_a_model_has_an_extent(extents: list[float], reason: str | None) -> None:
    body = AssetBody("model", np.zeros(3), np.array(extents))
    (check,) = check_bodies(Asset(Path("a.glb"), "gltf", 1.0, "y", (body,)), TREE, "chair")
    assert check.reason == reason


def test_a_stretched_side_is_named() -> None:
    body = AssetBody("model", np.zeros(3), CHAIR * [1, 1, 9])
    (check,) = check_bodies(Asset(Path("a.glb"), "gltf", 1.0, "y", (body,)), TREE, "chair")
    axes = {row["what"]: row.get("axis") for row in check.to_json()["hypotheses"]}
    assert axes["stretched"] == "length"
    assert all(axis is None for kind, axis in axes.items() if kind != "stretched")


def test_a_robot_needs_a_size(tmp_path: Path) -> None:
    (tmp_path / "a.urdf").write_text(
        '<robot name="r"><link name="l"><visual><geometry><box/></geometry></visual></link></robot>'
    )
    with pytest.raises(InputError, match="size"):
        read_asset(tmp_path / "a.urdf")


@pytest.mark.parametrize("ending", ["stl", "ply", "obj"])
def test_one_triangle_is_a_shape(ending: str, tmp_path: Path) -> None:
    file = tmp_path / f"a.{ending}"
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 1, 2]], process=False).export(file)
    assert read_asset(file).bodies[0].extents_m.tolist() == [1, 2, 0]
