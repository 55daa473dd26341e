"""A model that is written as glTF and read again has the same meshes, materials and textures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models3d.gltf.document import GltfWriter
from models3d.gltf.model_reader import read_model
from models3d.gltf.model_writer import add_mesh, write_gltf_model
from models3d.model import Material, Mesh, Model

TEXTURES = ("base_texture", "surface_texture", "normal_texture", "emissive_texture")
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def triangle(material: Material, **changes: Any) -> Model:
    """A model of one triangle."""
    uv = np.array([[0.0, 0], [1, 0], [0, 1]])
    mesh = Mesh(CORNERS, np.tile([0.0, 0, 1], (3, 1)), uv, np.array([[0, 1, 2]]), material)
    return Model("a.glb", (replace(mesh, **changes),))


def read_again(model: Model, folder: Path) -> Mesh:
    write_gltf_model(folder / "a.glb", model)
    (mesh,) = read_model(folder / "a.glb").meshes
    return mesh


def material_record(model: Model) -> dict[str, Any]:
    """The material of a model in the header of its glTF file."""
    writer = GltfWriter("test")
    data = writer.to_bytes([writer.add("nodes", {"mesh": add_mesh(writer, model)})])
    header = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    record: dict[str, Any] = header["materials"][0]
    return record | {"used": header.get("extensionsUsed", [])}


@pytest.mark.parametrize("name", TEXTURES)
@pytest.mark.parametrize("alpha", [255, 100])
def test_each_texture_is_that_of_its_use(name: str, alpha: int, tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (4, 3, 4), dtype=np.uint8)
    pixels[..., 3] = alpha
    material = Material(np.ones(4), emissive=np.ones(3), **{name: pixels})  # type: ignore[arg-type]
    mesh = read_again(triangle(material), tmp_path)
    for other in TEXTURES:
        found = getattr(mesh.material, other)
        if other == name:
            assert found is not None
            assert (found == pixels).all()
        else:
            assert found is None
    assert mesh.uv == pytest.approx(np.array([[0.0, 0], [1, 0], [0, 1]]))


def test_equal_textures_are_stored_once() -> None:
    pixels = np.full((2, 2, 4), 90, dtype=np.uint8)
    record = material_record(triangle(Material(np.ones(4), base_texture=pixels, normal_texture=pixels.copy())))
    assert record["normalTexture"] == record["pbrMetallicRoughness"]["baseColorTexture"] == {"index": 0}


@pytest.mark.parametrize(
    ("emissive", "factor", "strength"),
    [
        ([0.5, 0.2, 0.0], [0.5, 0.2, 0.0], None),
        ([1.0, 0.5, 0.0], [1.0, 0.5, 0.0], None),
        ([4.0, 2.0, 0], [1.0, 0.5, 0], 4),
    ],
)
def test_light_brighter_than_one_has_a_strength(
    emissive: list[float], factor: list[float], strength: float | None, tmp_path: Path
) -> None:
    model = triangle(Material(np.ones(4), emissive=np.array(emissive)))
    record = material_record(model)
    assert record["emissiveFactor"] == pytest.approx(factor)
    extensions = {} if strength is None else {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    assert record.get("extensions", {}) == extensions
    assert record["used"] == list(extensions)
    assert read_again(model, tmp_path).material.emissive == pytest.approx(emissive)


@pytest.mark.parametrize(
    ("changes", "mode", "cutoff"),
    [({"alpha_cutoff": 0.3, "blend": True}, "MASK", 0.3), ({"blend": True}, "BLEND", None), ({}, None, None)],
)
def test_alpha_modes(changes: dict[str, Any], mode: str | None, cutoff: float | None) -> None:
    record = material_record(triangle(Material(np.ones(4), **changes)))
    assert (record.get("alphaMode"), record.get("alphaCutoff")) == (mode, cutoff)


def test_factors_and_colours_are_at_most_one(tmp_path: Path) -> None:
    colour = np.array([[2.0, 0.5, -1.0, 1.0]] * 3)
    mesh = read_again(triangle(Material(np.array([3.0, 0.5, 0.5, 1]), 1.5, 2.0), color=colour), tmp_path)
    assert mesh.material.base_color == pytest.approx([1, 0.5, 0.5, 1])
    assert (mesh.material.metallic, mesh.material.roughness) == (1.0, 1.0)
    assert mesh.color == pytest.approx(np.array([[1.0, 0.5, 0.0, 1.0]] * 3))


@pytest.mark.parametrize(
    ("normal", "written"),
    [((0, 0, 2), (0, 0, 1)), ((0, 0, 0.6), (0, 0, 1)), ((0, 0, 0), (0, 1, 0)), ((0, 0, 0.4), (0, 1, 0))],
)
def test_a_normal_without_a_length_is_upward(
    normal: tuple[float, ...], written: tuple[float, ...], tmp_path: Path
) -> None:
    normals = np.tile(np.array(normal, dtype=float), (3, 1))
    assert read_again(triangle(Material(np.ones(4)), normals=normals), tmp_path).normals == pytest.approx(
        np.tile(written, (3, 1))
    )


def test_a_mesh_has_the_name_that_it_is_given() -> None:
    writer = GltfWriter("test")
    numbers = [add_mesh(writer, triangle(Material(np.ones(4))), name) for name in (None, "chair")]
    data = writer.to_bytes([])
    header = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert numbers == [0, 1]
    assert [mesh.get("name") for mesh in header["meshes"]] == [None, "chair"]
    assert "images" not in header
