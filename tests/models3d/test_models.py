"""glTF files: accepted and refused content, and the requested size."""

from __future__ import annotations

import base64
import json
import math
import struct
import zlib
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from insertion.placement.model_size import model_size
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError
from models3d.gltf.animation import Channel
from models3d.gltf.document import GltfDocument, GltfWriter
from models3d.gltf.model_reader import read_model
from models3d.model import Model
from tests.synthetic.insertions import write_glb
from tests.synthetic.rooms.shapes import solid

#: The head of a PNG of 60,000 x 60,000.
_HEAD = b"IHDR" + struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
_CHUNKS = ((13, _HEAD), (0, b"IDAT"))
LARGE_PNG = base64.b64encode(
    b"\x89PNG\r\n\x1a\n"
    + b"".join(struct.pack(">I", size) + body + struct.pack(">I", zlib.crc32(body)) for size, body in _CHUNKS)
).decode()
SIZE = np.array([0.5, 0.4, 0.9])


@pytest.fixture(scope="module")
def chair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_glb(solid("chair", SIZE), tmp_path_factory.mktemp("model") / "chair.glb")


def _with(chair: Path, out: Path, **changes: object) -> Path:
    """The file with fields of its JSON changed."""
    data = chair.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    text = json.dumps(json.loads(data[20 : 20 + length]) | changes).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<IIIII", 0x46546C67, 2, 20 + len(text) + len(data) - 20 - length, len(text), 0x4E4F534A)
    out.write_bytes(head + text + data[20 + length :])
    return out


def test_a_model_has_the_size_of_its_file(chair: Path) -> None:
    model = read_model(chair)
    assert model.size_m == pytest.approx({"length": 0.5, "width": 0.4, "height": 0.9}, rel=1e-6)
    assert model.warnings == ()


def test_a_dark_linear_factor_keeps_its_digits(chair: Path, tmp_path: Path) -> None:
    dark = [0.0031, 0.0132, 0.0007, 1.0]
    material = [{"pbrMetallicRoughness": {"baseColorFactor": dark, "metallicFactor": 0.25, "roughnessFactor": 0.5}}]
    part = read_model(_with(chair, tmp_path / "dark.glb", materials=material)).meshes[0]
    assert part.material.base_color == pytest.approx(dark)
    assert (part.material.metallic, part.material.roughness) == (0.25, 0.5)


def test_faces_without_normals_are_flat(chair: Path) -> None:
    """Averaged normals at the corners of a box turn its faces away from the light."""
    part = read_model(chair).meshes[0]
    corners = part.vertices[part.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    assert part.normals[part.faces] == pytest.approx(np.repeat(across[:, None], 3, axis=1), abs=1e-6)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"asset": {"version": "1.0"}}, "asset.version"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "cli copy IN.glb .*KHR_draco_mesh_compression"),
        ({"nodes": [{"mesh": 0, "matrix": [math.nan] * 16}]}, "the word NaN"),
        ({"animations": 7}, "animations: expected an array"),
        ({"meshes": []}, "chair|expected"),
        ({"accessors": []}, "accessor: expected a number"),
        ({"meshes": [{"primitives": 3}]}, "expected a readable"),
        ({"extensionsRequired": ["KHR_new"]}, "KHR_texture_transform, .*found KHR_new"),
        ({"scenes": [{"nodes": [7]}]}, "expected a readable"),
        ({"bufferViews": [{"buffer": 0, "byteOffset": 10**12, "byteLength": 12}] * 12}, "byteOffset: expected"),
        ({"accessors": [{"count": 10**12, "componentType": 5126, "type": "VEC3"}]}, "count: expected a whole number"),
        ({"nodes": [{"children": [1]}, {"children": [0]}]}, "no circle"),
        ({"nodes": [{"children": [1]}, {}, {"children": [1]}]}, r"nodes\[1\]: expected one parent"),
        ({"nodes": [{"mesh": 0}] * 99_000}, "at most 2000000 triangles"),
        ({"nodes": [{"children": [n + 1]} for n in range(999)] + [{"mesh": 0}]}, "at most 500 levels"),
        ({"images": [{"uri": "../../etc/passwd"}]}, r"images\[0\] uri: expected a file in the folder of the model"),
        ({"images": [{"uri": "http://example.org/x.png"}]}, "expected an existing file"),
        ({"images": [{"uri": "bad.glb"}]}, "expected a PNG, JPEG or WebP"),
        ({"images": [{"uri": "data:image/png;base64," + LARGE_PNG}]}, "expected at most 67,108,864 pixels"),
        ({"materials": [{"pbrMetallicRoughness": {"metallicFactor": -5}}]}, "colours of four and three numbers"),
    ],
)
def test_what_cannot_be_read_is_named(chair: Path, tmp_path: Path, changes: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_model(_with(chair, tmp_path / "bad.glb", **changes))


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(cut=st.integers(0, 4000), noise=st.binary(max_size=40))
def test_a_damaged_file_is_refused_or_read(chair: Path, tmp_path: Path, cut: int, noise: bytes) -> None:
    data = bytearray(chair.read_bytes())
    cut = min(cut, len(data))
    data[cut : cut + len(noise)] = noise
    file = tmp_path / "damaged.glb"
    file.write_bytes(bytes(data[: max(cut, 24)]) if len(noise) % 2 else bytes(data))
    try:
        bounds = read_model(file).bounds
    except InputError as error:
        bounds, words = np.zeros(1), str(error)
    else:
        words = str(file)
    assert np.isfinite(bounds).all()
    assert str(file) in words


def test_the_size_asked_for(chair: Path) -> None:
    model = read_model(chair)
    assert model_size(model, "file").factor == 1.0
    assert model_size(model, "height=0.45").factor == pytest.approx(0.5)
    for words in ("height=0", "height=-1", "height=nan", "size=3", "tall", "prior"):
        with pytest.raises(InputError, match="--size"):
            model_size(model, words)


SQUARE = np.array([[0.0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0.2, 0.2, 0]])
CORNERS = SQUARE[:, :2] * 5


def _square(
    file: Path, change: Callable[[dict[str, Any], GltfWriter], None], material: dict[str, Any] | None = None
) -> Model:
    """A strip of two triangles with a texture, after `change` of its primitive, as it is read."""
    document = GltfWriter("test")
    picture = document.add_texture(np.full((2, 2, 4), 200, np.uint8))
    colour = {"baseColorTexture": {"index": picture}, "metallicFactor": 0.0}
    document.add("materials", {"pbrMetallicRoughness": colour} | (material or {}))
    attributes = {"POSITION": document.add_accessor(SQUARE), "TEXCOORD_0": document.add_accessor(CORNERS)}
    primitive: dict[str, Any] = {"attributes": attributes, "mode": 5, "material": 0}
    change(primitive, document)
    document.add("meshes", {"primitives": [primitive]})
    file.write_bytes(document.to_bytes([document.add("nodes", {"mesh": 0})]))
    return read_model(file)


def test_a_strip_is_two_triangles_that_look_the_same_way(tmp_path: Path) -> None:
    (part,) = _square(tmp_path / "a.glb", lambda *_: None).meshes
    assert len(part.faces) == 2
    np.testing.assert_allclose(part.normals, np.tile([0, 0, 1.0], (6, 1)))


@pytest.mark.parametrize("name", ["POSITION", "NORMAL"])
@pytest.mark.parametrize("added", [SQUARE[:3], np.vstack([SQUARE, SQUARE[:1]]), np.full((4, 3), np.nan)])
def test_a_morph_target_has_a_finite_value_for_every_vertex(tmp_path: Path, added: FloatArray, name: str) -> None:
    def morph(primitive: dict[str, Any], document: GltfWriter) -> None:
        primitive["targets"] = [{name: document.add_accessor(added)}]

    with pytest.raises(InputError, match="targets: expected 4 finite values"):
        _square(tmp_path / "a.glb", morph)


@pytest.mark.parametrize("scale", [[2.0, 1.0, 1.0], [-2.0, 1.0, 1.0]])
def test_normals_and_faces_follow_their_node(tmp_path: Path, scale: list[float]) -> None:
    """Normals turn with the inverse transpose, and a mirrored mesh keeps its outside outside."""
    document = GltfWriter("test")
    tilted = np.array([[0.0, 0, 0], [1, 0, 1], [0, 1, 0]])  # its normal is (-1, 0, 1)
    unit = np.tile(np.array([-1.0, 0, 1]) / np.sqrt(2), (3, 1))
    attributes = {"POSITION": document.add_accessor(tilted), "NORMAL": document.add_accessor(unit)}
    document.add("meshes", {"primitives": [{"attributes": attributes}]})
    file = tmp_path / "a.glb"
    file.write_bytes(document.to_bytes([document.add("nodes", {"mesh": 0, "scale": scale})]))
    (part,) = read_model(file).meshes
    one, two, three = part.vertices[part.faces[0]]
    across = np.cross(two - one, three - one)
    np.testing.assert_allclose(part.normals[0], across / np.linalg.norm(across), atol=1e-6)
    assert part.normals[0] @ [-np.sign(scale[0]), 0, 2] > 0.9


@pytest.mark.parametrize("alpha", [[], [0.25]])
def test_vertex_colours_stay_beside_a_material_and_are_not_rounded(tmp_path: Path, alpha: list[float]) -> None:
    tint = np.array([0.1234567, 0.5, 0.002, *alpha])
    (part,) = _square(
        tmp_path / "a.glb", lambda p, d: p["attributes"].update(COLOR_0=d.add_accessor(np.tile(tint, (4, 1))))
    ).meshes
    assert part.color is not None
    np.testing.assert_allclose(part.color[0], [*tint, 1][:4], rtol=1e-6)
    assert part.material.base_texture is not None


@pytest.mark.parametrize(
    ("moved", "uv"),
    [
        ({"offset": [0.1, 0.2], "rotation": np.pi / 2, "scale": [2, 3]}, (3 * 1 + 0.1, -2 * 1 + 0.2)),
        ({"offset": [0.1, 0.2]}, (1.1, 1.2)),
        ({"scale": [2, 3]}, (2, 3)),
        ({}, (1, 1)),
    ],
)
def test_a_texture_takes_its_own_coordinates(tmp_path: Path, moved: dict[str, Any], uv: tuple[float, float]) -> None:
    """The second set, scaled, turned by a quarter and moved, as three.js and Khronos' viewer do it."""
    moved = {"texCoord": 1, **moved}

    def change(primitive: dict[str, Any], document: GltfWriter) -> None:
        primitive["attributes"]["TEXCOORD_1"] = document.add_accessor(CORNERS + 1)

    colour = {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": moved}}}
    (part,) = _square(tmp_path / "a.glb", change, {"pbrMetallicRoughness": colour}).meshes
    assert tuple(part.uv[0]) == pytest.approx(uv)  # corner (1, 1) of the second set


def test_a_material_that_says_nothing_is_white_metal_without_a_glow(tmp_path: Path) -> None:
    """glTF 2.0, 5.22: the defaults."""
    (part,) = _square(tmp_path / "a.glb", lambda *_: None, {"pbrMetallicRoughness": {}}).meshes
    material = part.material
    assert (material.base_color.tolist(), material.metallic, material.roughness) == ([1, 1, 1, 1], 1.0, 1.0)
    assert (material.emissive.tolist(), material.blend, material.alpha_cutoff) == ([0, 0, 0], False, None)


def test_corners_that_are_not_there_are_named(tmp_path: Path) -> None:
    def change(primitive: dict[str, Any], document: GltfWriter) -> None:
        primitive["indices"] = document.add_accessor(np.array([0, 1, 4], np.uint32))

    with pytest.raises(InputError, match="indices: expected numbers from 0 to 3"):
        _square(tmp_path / "a.glb", change)


def test_a_texture_with_other_coordinates_than_the_colour_is_left_out_with_a_word(tmp_path: Path) -> None:
    model = _square(tmp_path / "a.glb", lambda *_: None, {"normalTexture": {"index": 0, "texCoord": 1}})
    assert model.meshes[0].material.normal_texture is None
    assert model.warnings == ("a texture with other coordinates than the first one is ignored",)


def test_glass_is_seen_through_and_lamps_shine(tmp_path: Path) -> None:
    extensions = {
        "KHR_materials_transmission": {"transmissionFactor": 0.6},
        "KHR_materials_emissive_strength": {"emissiveStrength": 4.0},
    }
    model = _square(tmp_path / "a.glb", lambda *_: None, {"extensions": extensions, "emissiveFactor": [0, 0.5, 0]})
    material = model.meshes[0].material
    assert (material.blend, material.base_color[3]) == (True, pytest.approx(0.4))
    assert material.emissive.tolist() == [0, 2.0, 0]
    assert material.transmission == 0.6
    assert material.tint.tolist() == [1, 1, 1]
    assert not model.warnings


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.int16])
def test_normalised_integers_are_shares(tmp_path: Path, kind: type[np.integer[Any]]) -> None:
    header = {
        "bufferViews": [{"buffer": 0, "byteLength": 2 * 4 * np.dtype(kind).itemsize}],
        "accessors": [{
            "bufferView": 0, "count": 4, "type": "VEC2", "normalized": True,
            "componentType": {np.uint8: 5121, np.uint16: 5123, np.int16: 5122}[kind],
        }],
    }  # fmt: skip
    data = (CORNERS * np.iinfo(kind).max).astype(kind).tobytes()
    np.testing.assert_allclose(GltfDocument(header, [data]).accessor(0, (2,)), CORNERS)


def test_sparse_values_replace_others() -> None:
    data = np.array([1, 2], "<u2").tobytes() + np.array([[3, 0, 0], [0, 3, 0]], "<f4").tobytes()
    header = {
        "bufferViews": [{"buffer": 0, "byteLength": 4}, {"buffer": 0, "byteOffset": 4, "byteLength": 24}],
        "accessors": [{
            "count": 3, "type": "VEC3", "componentType": 5126,
            "sparse": {"count": 2, "indices": {"bufferView": 0, "componentType": 5123}, "values": {"bufferView": 1}},
        }],
    }  # fmt: skip
    assert GltfDocument(header, [data]).accessor(0, (3,)).tolist() == [[0, 0, 0], [3, 0, 0], [0, 3, 0]]
    header["accessors"][0]["sparse"]["count"] = 9
    with pytest.raises(FieldError, match=r"sparse\.count"):
        GltfDocument(header, [data]).accessor(0, (3,))


def test_a_morph_target_tilts_the_normals(tmp_path: Path) -> None:
    document = GltfWriter("test")
    flat, tilt = np.tile([0.0, 0, 1], (3, 1)), np.tile([1.0, 0, 0], (3, 1))
    attributes = {"POSITION": document.add_accessor(SQUARE[:3]), "NORMAL": document.add_accessor(flat)}
    targets = [{"NORMAL": document.add_accessor(tilt)}]
    document.add("meshes", {"primitives": [{"attributes": attributes, "targets": targets}]})
    file = tmp_path / "a.glb"
    for weight, expected in ((0.0, [0.0, 0, 1]), (1.0, [0.5**0.5, 0, 0.5**0.5]), (-1.0, [-(0.5**0.5), 0, 0.5**0.5])):
        node = document.add("nodes", {"mesh": 0, "weights": [weight]})
        file.write_bytes(document.to_bytes([node]))
        np.testing.assert_allclose(read_model(file).meshes[0].normals[0], expected, atol=1e-6)


@pytest.mark.parametrize(("transmission", "opacity"), [(0.8, 0.2), (0.9, 0.15), (1.0, 0.15)])
def test_glass_has_an_opacity_of_15_percent_or_more(tmp_path: Path, transmission: float, opacity: float) -> None:
    glass = {"extensions": {"KHR_materials_transmission": {"transmissionFactor": transmission}}}
    model = _square(tmp_path / "a.glb", lambda *_: None, glass)
    assert model.meshes[0].material.base_color[3] == pytest.approx(opacity)
    assert model.meshes[0].material.blend
    assert model.meshes[0].material.transmission == transmission


@pytest.mark.parametrize(("alpha", "transmission"), [(0.25, 1.0), (0.49, 1.0), (0.51, 0.0)])
def test_a_transparent_material_without_texture_is_glass(tmp_path: Path, alpha: float, transmission: float) -> None:
    surface = {"baseColorFactor": [0.2, 0.4, 0.1, alpha], "roughnessFactor": 0.7}
    model = _square(tmp_path / "a.glb", lambda *_: None, {"alphaMode": "BLEND", "pbrMetallicRoughness": surface})
    material = model.meshes[0].material
    assert material.transmission == transmission
    assert material.base_color[3] == pytest.approx(alpha)
    if transmission:
        assert material.tint == pytest.approx((1 - alpha) * np.array([0.5, 1.0, 0.25]))
        assert material.roughness == 0.1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rotation_is_interpolated_on_the_shorter_arc(sign: float) -> None:
    """q and -q are one rotation: halfway between 0 and 90 degrees about y are 45 degrees, with both signs."""
    half = np.radians(45)
    keys = np.array([[0.0, 0, 0, 1], [0, sign * np.sin(half), 0, sign * np.cos(half)]])
    middle = Channel(0, "rotation", "LINEAR", np.array([0.0, 1.0]), keys).at(0.5)
    np.testing.assert_allclose(abs(middle @ [0, np.sin(half / 2), 0, np.cos(half / 2)]), 1.0)


GLOSSY = {"diffuseFactor": [0.2, 0.4, 0.6, 1.0], "glossinessFactor": 0.7}


@pytest.mark.parametrize(
    ("glossy", "surface", "roughness", "has_texture"),
    [
        (GLOSSY, {}, 0.3, False),
        (GLOSSY | {"diffuseTexture": {"index": 0}}, {}, 0.3, True),
        ({}, {}, 0.0, False),
        (GLOSSY, {"roughnessFactor": 0.9}, 0.9, False),  # the standard's material comes first
    ],
)
def test_a_material_of_specular_and_glossiness_is_no_metal(
    tmp_path: Path, glossy: dict[str, Any], surface: dict[str, Any], roughness: float, has_texture: bool
) -> None:
    material = {"extensions": {"KHR_materials_pbrSpecularGlossiness": glossy}, "pbrMetallicRoughness": surface}
    (part,) = _square(tmp_path / "a.glb", lambda *_: None, material).meshes
    assert part.material.roughness == pytest.approx(roughness)
    assert (part.material.base_texture is not None) == has_texture
    assert part.material.metallic == (1.0 if surface else 0.0)
    if glossy and not surface:
        assert part.material.base_color.tolist() == [0.2, 0.4, 0.6, 1.0]


def test_a_texture_without_an_image_that_is_read_is_ignored_with_one_warning(tmp_path: Path) -> None:
    def change(_: dict[str, Any], document: GltfWriter) -> None:
        document.add("textures", {"extensions": {"KHR_texture_basisu": {"source": 0}}})

    colours = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}, "normalTexture": {"index": 1}}
    model = _square(tmp_path / "a.glb", change, colours)
    assert model.meshes[0].material.base_texture is None
    assert model.warnings == ("a texture without a PNG, JPEG or WebP image is ignored",)


def test_sixteen_bits_of_a_texture_are_reduced_to_eight(tmp_path: Path) -> None:
    grey = np.array([[0, 256, 65535]], dtype=np.uint16)
    data = base64.b64encode(cv2.imencode(".png", grey)[1].tobytes()).decode()

    def change(_: dict[str, Any], document: GltfWriter) -> None:
        document.add("images", {"uri": f"data:image/png;base64,{data}"})
        document.add("textures", {"source": 1})

    (part,) = _square(tmp_path / "a.glb", change, {"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}}).meshes
    assert part.material.base_texture is not None
    assert part.material.base_texture[0].tolist() == [[0, 0, 0, 255], [1, 1, 1, 255], [255, 255, 255, 255]]


def _animated(file: Path, path: str = "translation", node: int | None = 0, **changes: Any) -> Model:
    document = GltfWriter("test")
    mesh = {"primitives": [{"attributes": {"POSITION": document.add_accessor(SQUARE)}, "mode": 5}]}
    document.add("meshes", mesh)
    times = np.array(changes.get("times", [0.0, 1.0]))
    values = np.array(changes.get("values", [[0.0, 0, 0], [1, 2, 3]]))
    sampler = {"input": document.add_accessor(times[:, None]), "output": document.add_accessor(values)}
    sampler |= {"interpolation": changes["kind"]} if "kind" in changes else {}
    target = {"path": path} | ({} if node is None else {"node": node})
    document.add("animations", {"samplers": [sampler], "channels": [{"sampler": 0, "target": target}]})
    file.write_bytes(document.to_bytes([document.add("nodes", {"mesh": 0})]))
    return read_model(file)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, None),
        ({"kind": "STEP"}, None),
        ({"kind": "CUBICSPLINE", "values": np.zeros((6, 3))}, None),
        ({"kind": "CUBICSPLINE"}, "output: expected values for each of 2 times"),
        ({"kind": "SPLINE"}, "interpolation: expected"),
        ({"times": [0.0, 0.0]}, "input: expected rising times from 0"),
        ({"times": [-0.1, 1.0]}, "input: expected rising times from 0"),
        ({"times": [0.0, np.nan]}, "input: expected rising times from 0"),
        ({"values": [[0.0, 0, np.nan], [1, 2, 3]]}, "output: expected finite numbers"),
        ({"values": np.zeros((3, 3))}, "output: expected values for each of 2 times"),
        ({"node": 1}, "node: expected one of the file's"),
        ({"node": -1}, "node: expected one of the file's"),
        ({"node": None, "kind": "SPLINE"}, None),  # a channel of another extension
        ({"path": "pointer", "kind": "SPLINE"}, None),
    ],
)
def test_keyframes_of_an_animation_are_checked(tmp_path: Path, changes: dict[str, Any], message: str | None) -> None:
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        assert _animated(tmp_path / "a.glb", **changes).meshes
