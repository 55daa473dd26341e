"""The exports say where the camera and the object are, in metres."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.projection.cameras import pixels_in_view
from estimator.records.scene import Camera
from estimator.scene_formats.nerfstudio import read_nerfstudio
from insertion.blender.run import export_blend, run_blender, traced_layers
from insertion.colour import srgb_to_linear
from insertion.composite.camera_look import measure_gain
from insertion.exports.compositing import exr_bytes
from insertion.exports.export_folder import LayerWriter
from insertion.exports.gltf_scene import write_gltf_scene
from insertion.exports.metric_frame import camera_keyframes, metric_transform, object_matrix
from insertion.exports.nerfstudio import write_transforms
from insertion.exports.usd_scene import write_usd_scene
from insertion.insert import insert
from insertion.insertion_scene import InsertionScene
from insertion.light.environment_estimate import environment_at
from insertion.light.environment_map import Environment
from insertion.placement.placed_object import PlacedObject
from insertion.render.studio import camera_axes
from insertion.request import InsertionRequest, ObjectRequest, SceneSource
from insertion.scene.camera_rays import surface_normals
from models3d.gltf.document import GltfWriter
from tests.insertion.exports.test_compositing_layers import read_exr
from tests.synthetic.insertions import place_in, prepared_scene_of, video_room, write_glb
from tests.synthetic.rooms.shapes import solid

HEIGHT = 0.8


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[InsertionScene, PlacedObject]:
    room = video_room("bedroom", 1001, tmp_path_factory.mktemp("room"), views=4)
    prepared = prepared_scene_of(room)
    model = write_glb(solid("chair", np.array([0.4, 0.4, HEIGHT])), room.folder / "chair.glb")
    return prepared, place_in(prepared, [ObjectRequest(model, facing=30.0)])[0]


def _environment(prepared: InsertionScene, placed: PlacedObject) -> Environment:
    position, basis = placed.placement.position, placed.placement.basis
    return environment_at(position, HEIGHT, basis, prepared.content.cloud, prepared.images)


def _export_blend(folder: Path, prepared: InsertionScene, placed: PlacedObject) -> list[str]:
    return export_blend(folder, [placed], prepared.footage.frames, _environment(prepared, placed))


def _pixel(matrix: np.ndarray, focal: float, centre: tuple[float, float], point: np.ndarray) -> np.ndarray:
    """A point of the metric frame through an OpenGL camera."""
    local = np.linalg.inv(matrix) @ np.append(point, 1.0)
    return np.array([centre[0] + focal * local[0] / -local[2], centre[1] - focal * local[1] / -local[2]])


def test_a_metric_camera_sees_the_foot_where_the_scene_does(scene: tuple[InsertionScene, PlacedObject]) -> None:
    prepared, placed = scene
    frame = metric_transform([placed])
    for shot, key in zip(prepared.footage.frames, camera_keyframes(prepared.footage.frames, frame), strict=True):
        view = shot.view
        assert view is not None
        local = view.rotation @ placed.placement.position + view.translation
        pixel = view.camera.params[0] * local[:2] / local[2] + view.camera.params[2:]
        top = placed.placement.position + placed.placement.basis[2] * HEIGHT / prepared.scale.metres_per_unit
        assert _pixel(key.matrix, 500.0, (320.0, 240.0), np.zeros(3)) == pytest.approx(pixel, abs=1e-6)
        assert frame(top[None])[0] == pytest.approx([0, HEIGHT, 0], abs=1e-9)


def test_the_model_has_its_metres(scene: tuple[InsertionScene, PlacedObject]) -> None:
    _, placed = scene
    matrix = object_matrix(placed, metric_transform([placed]))
    corners = np.concatenate([part.vertices for part in placed.model.meshes]) @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)
    assert corners[:, 1].min() == pytest.approx(0, abs=1e-6)
    assert corners[:, 1].max() == pytest.approx(HEIGHT, abs=1e-5)


def _header(file: Path) -> dict[str, Any]:
    """The JSON of a GLB file."""
    data = file.read_bytes()
    header: dict[str, Any] = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    return header


def test_glb_has_an_animated_camera(scene: tuple[InsertionScene, PlacedObject], tmp_path: Path) -> None:
    import trimesh

    prepared, placed = scene
    frame = metric_transform([placed])
    keys = camera_keyframes(prepared.footage.frames, frame)
    write_gltf_scene(tmp_path / "scene.glb", [placed], keys, frame)
    header = _header(tmp_path / "scene.glb")
    assert header["cameras"][0]["perspective"]["yfov"] == pytest.approx(2 * np.arctan(240 / 500))
    assert header["accessors"][header["animations"][0]["samplers"][0]["input"]]["count"] == len(keys)
    extents = trimesh.load_scene(tmp_path / "scene.glb").extents
    assert extents[1] == pytest.approx(HEIGHT, rel=1e-4)


@pytest.mark.parametrize("strength", [0.5, 4.0])
def test_files_have_the_glow_and_the_tints_of_the_model(
    scene: tuple[InsertionScene, PlacedObject], tmp_path: Path, strength: float
) -> None:
    pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd

    prepared, placed = scene
    (part,) = placed.model.meshes
    material = replace(part.material, base_color=[0.5, 0.25, 1.0, 1.0], emissive=[strength, 0, strength / 2])
    tint = np.tile([0.4, 0.8, 0.6, 1.0], (len(part.vertices), 1))
    model = replace(placed.model, meshes=(replace(part, color=tint, material=material),))
    frame = metric_transform([placed])
    keys = camera_keyframes(prepared.footage.frames, frame)
    write_gltf_scene(tmp_path / "scene.glb", [replace(placed, model=model)], keys, frame)
    (record,) = _header(tmp_path / "scene.glb")["materials"]
    extension = record.get("extensions", {}).get("KHR_materials_emissive_strength", {"emissiveStrength": 1.0})
    glow = np.array(record["emissiveFactor"]) * extension["emissiveStrength"]
    assert glow == pytest.approx([strength, 0, strength / 2])
    assert max(record["emissiveFactor"]) <= 1
    write_usd_scene(tmp_path / "scene.usda", [replace(placed, model=model)], keys, frame, 25.0)
    usd = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    (mesh,) = (prim for prim in usd.Traverse() if prim.GetTypeName() == "Mesh")
    assert np.array(mesh.GetAttribute("primvars:displayColor").Get()) == pytest.approx(
        np.tile([0.2, 0.2, 0.6], (len(tint), 1)), abs=1e-6
    )


def test_usd_has_the_same_camera(scene: tuple[InsertionScene, PlacedObject], tmp_path: Path) -> None:
    pxr = pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd, UsdGeom

    assert pxr is not None
    prepared, placed = scene
    frame = metric_transform([placed])
    keys = camera_keyframes(prepared.footage.frames, frame)
    write_usd_scene(tmp_path / "scene.usda", [placed], keys, frame, 25.0)
    usd = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    assert UsdGeom.GetStageMetersPerUnit(usd) == 1.0
    camera = UsdGeom.Xformable(usd.GetPrimAtPath("/World/camera"))
    for key in keys:
        matrix = np.array(camera.ComputeLocalToWorldTransform(key.time_s * 25)).T
        assert matrix == pytest.approx(key.matrix, abs=1e-9)
    lens = UsdGeom.Camera(usd.GetPrimAtPath("/World/camera")).GetCamera(0)
    # USD states lenses in tenths of a scene unit: 36 mm are 0.36 where a unit is a metre
    assert lens.horizontalAperture == pytest.approx(0.36)
    assert lens.focalLength / lens.horizontalAperture == pytest.approx(500 / 640)
    assert (lens.clippingRange.min, lens.clippingRange.max) == pytest.approx((0.01, 1000))
    bounds = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(
        usd.GetPrimAtPath("/World/object1")
    )
    assert bounds.ComputeAlignedRange().GetSize()[1] == pytest.approx(HEIGHT, rel=1e-4)


def test_nerfstudio_has_the_pixels_and_the_points_of_the_scene(
    scene: tuple[InsertionScene, PlacedObject], tmp_path: Path
) -> None:
    """Read again as nerfstudio's files are read: pixels count from the corner, as in COLMAP."""
    prepared, placed = scene
    frame = metric_transform([placed])
    keys = camera_keyframes(prepared.footage.frames, frame)
    write_transforms(tmp_path / "transforms.json", keys, "pictures", frame(prepared.scene.points))
    again = read_nerfstudio(tmp_path / "transforms.json")
    metres = prepared.scale.metres_per_unit
    assert np.ptp(again.points[:, 2]) == pytest.approx(
        np.ptp(prepared.scene.points @ placed.placement.basis[2]) * metres
    )
    for view, shot in zip(again.views, prepared.footage.frames, strict=True):
        assert shot.view is not None
        pixels = pixels_in_view(view, again.points[:50])[0]
        np.testing.assert_allclose(pixels, pixels_in_view(shot.view, prepared.scene.points[:50])[0], atol=1e-2)


def test_pictures_of_two_cameras_keep_both(scene: tuple[InsertionScene, PlacedObject], tmp_path: Path) -> None:
    prepared, placed = scene
    frame = metric_transform([placed])
    keys = camera_keyframes(prepared.footage.frames, frame)
    other = replace(keys[1].camera, model="PINHOLE", height=640, width=480, params=np.array([400.0, 410, 240, 320]))
    keys[1] = replace(keys[1], camera=other)
    write_gltf_scene(tmp_path / "scene.glb", [placed], keys, frame)
    header = _header(tmp_path / "scene.glb")
    lenses = [lens["perspective"] for lens in header["cameras"]]
    assert [lens["yfov"] for lens in lenses] == pytest.approx([2 * np.arctan(240 / 500), 2 * np.arctan(320 / 410)])
    assert lenses[1]["aspectRatio"] == pytest.approx((240 / 400) / (320 / 410))
    counts = [header["accessors"][row["samplers"][0]["input"]]["count"] for row in header["animations"]]
    assert counts == [len(keys) - 1, 1]
    write_transforms(tmp_path / "transforms.json", keys, "pictures", frame(prepared.scene.points))
    sizes = [(view.camera.width, view.camera.height) for view in read_nerfstudio(tmp_path / "transforms.json").views]
    assert sizes == [(key.camera.width, key.camera.height) for key in keys]


#: Stands in for Blender: keeps its arguments, compiles the script, and writes what the job requests.
BLENDER = """#!{python}
import json, sys
from pathlib import Path
import numpy as np
words = sys.argv[1:]
script, file = words[words.index("--python") + 1], words[-1]
compile(Path(script).read_text(), script, "exec")
job = json.loads(Path(file).read_text())
Path("{record}").write_text(json.dumps({{"words": words, "job": job}}))
assert Path(job["environment"]).stat().st_size > 1000
if job.get("blend"):
    Path(job["blend"]).write_bytes(b"BLENDER")
for key in job["keys"] if job.get("out") else ():
    layer = np.zeros((job["window"]["height"], job["window"]["width"], 4), np.float16)
    layer[100:140, 200:260] = [0.5, 0.0, 0.0, 1.0]
    np.save(Path(job["out"]) / (key["stem"] + ".npy"), layer)
"""


@pytest.fixture
def blender(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file to which a stand-in for Blender writes its arguments."""
    program = tmp_path / "blender"
    program.write_text(BLENDER.format(python=sys.executable, record=tmp_path / "asked.json"))
    program.chmod(0o755)
    monkeypatch.setenv("METRIC_TREE_BLENDER", str(program))
    return tmp_path / "asked.json"


@pytest.mark.slow
def test_blender_is_asked_for_the_scene_in_metres(
    scene: tuple[InsertionScene, PlacedObject], blender: Path, tmp_path: Path
) -> None:
    prepared, placed = scene
    assert _export_blend(tmp_path, prepared, placed) == []
    assert (tmp_path / "scene.blend").read_bytes() == b"BLENDER"
    asked = json.loads(blender.read_text())
    assert asked["words"][:3] == ["--background", "--factory-startup", "--python"]
    assert asked["words"][-2] == "--"
    frame = metric_transform([placed])
    keys = camera_keyframes(prepared.footage.frames, frame)
    for stated, key in zip(asked["job"]["keys"], keys, strict=True):
        np.testing.assert_allclose(stated["matrix"], key.matrix)
    np.testing.assert_allclose(asked["job"]["objects"][0]["matrix"], object_matrix(placed, frame))


#: Run by the Python that has bpy: the content of a saved scene.
OPENED = """
import json, sys, bpy, numpy as np
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
meshes = [item for item in bpy.data.objects if item.type == "MESH" and not item.is_shadow_catcher]
corners = np.array([item.matrix_world @ vertex.co for item in meshes for vertex in item.data.vertices])
scene = bpy.context.scene
print("SAW" + json.dumps({
    "height": float(np.ptp(corners[:, 2])), "lowest": float(corners[:, 2].min()),
    "packed": [image.packed_file is not None for image in bpy.data.images if image.source == "FILE"],
    "catchers": sum(item.is_shadow_catcher for item in bpy.data.objects if item.type == "MESH"),
    "moves": scene.camera.animation_data is not None and scene.frame_end > scene.frame_start,
}))
"""


#: The same: where the origin is in the image of the first frame, and what is behind the camera.
CAMERA_IN_BLENDER = """
import json, sys, bpy
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
scene = bpy.context.scene
scene.frame_set(0)
x, y, _ = world_to_camera_view(scene, scene.camera, Vector((0, 0, 0)))
behind = scene.camera.data.background_images[0]
print("SAW" + json.dumps({
    "foot": [x * scene.render.resolution_x, (1 - y) * scene.render.resolution_y],
    "engine": scene.render.engine, "first": scene.frame_start, "transparent": scene.render.film_transparent,
    "plate": behind.image.filepath, "plates": behind.image_user.frame_duration,
    "catchers": sum(item.is_shadow_catcher for item in bpy.data.objects if item.type == "MESH"),
}))
"""


def run_with_bpy(*words: object) -> str:
    """Return the output of a script in the Python that has bpy."""
    program = os.environ.get("METRIC_TREE_BLENDER", "")
    if "python" not in Path(program).name:
        pytest.skip("METRIC_TREE_BLENDER names no Python with bpy (pip install bpy)")
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [program, *map(str, words)], capture_output=True, text=True, env=clean, check=True, timeout=300
    ).stdout


def test_the_real_blender_saves_the_object_in_metres(
    scene: tuple[InsertionScene, PlacedObject], tmp_path: Path
) -> None:
    prepared, placed = scene
    run_with_bpy("-c", "")  # skips without Blender
    assert _export_blend(tmp_path, prepared, placed) == []
    said = run_with_bpy("-c", OPENED, tmp_path / "scene.blend")
    saw = json.loads(said.partition("SAW")[2].splitlines()[0])
    assert saw["height"] == pytest.approx(placed.size_m["height"], rel=1e-4)
    assert saw["lowest"] == pytest.approx(0.0, abs=1e-5)
    assert (saw["packed"], saw["catchers"], saw["moves"]) == ([True], 1, True)


def test_blender_joins_the_layers_to_our_frame(scene: tuple[InsertionScene, PlacedObject], tmp_path: Path) -> None:
    import cv2

    prepared, placed = scene
    out, layers = tmp_path / "out", tmp_path / "layers"
    source = SceneSource(folder=tmp_path, scale=prepared.scale)
    request = InsertionRequest(scene=source, objects=(placed.request,), out=out, layers=layers, frames=(1, 2))
    insert(request, prepared)
    job = json.loads((layers / "blender" / "job.json").read_text())
    assert (job["first"], job["last"], [key["frame"] for key in job["keys"]]) == (1, 2, [1, 2])
    assert all((layers / name / "000001.exr").is_file() for name in ("plate", "object", "shadow", "matte"))
    run_with_bpy(layers / "blender" / "scene.py", "--render", tmp_path / "again", "--only", "joined")
    assert (layers / "scene.blend").is_file()
    for number, ours in enumerate(sorted(out.iterdir()), start=1):  # every frame was the first one
        theirs = tmp_path / "again" / "joined" / f"{number:06d}.png"
        frame, again = (cv2.imread(str(file)).astype(int) for file in (ours, theirs))
        assert np.abs(frame - again).max() <= 1
        assert (frame == again).mean() > 0.98


@pytest.mark.parametrize("centre", [(320.0, 240.0), (250.0, 290.0)])
def test_the_exported_camera_has_the_principal_point(
    scene: tuple[InsertionScene, PlacedObject], tmp_path: Path, centre: tuple[float, float]
) -> None:
    """The plate is behind the camera, and the foot of the object has its pixel."""
    run_with_bpy("-c", "")
    prepared, placed = scene
    camera = Camera("PINHOLE", 640, 480, np.array([500.0, 500.0, *centre]))
    frames = [replace(shot, view=replace(shot.view, camera=camera)) for shot in prepared.footage.frames if shot.view]
    frames = [replace(shot, name=f"{shot.index:06d}.png") for shot in frames]  # as those of a video
    writer = LayerWriter(tmp_path, frames, prepared.scale.metres_per_unit)
    for shot in frames:
        writer.plate(shot, np.full((480, 640, 3), 90, np.uint8))
    environment = _environment(prepared, placed)
    assert export_blend(tmp_path, [placed], frames, environment) == []
    saw = json.loads(
        run_with_bpy("-c", CAMERA_IN_BLENDER, tmp_path / "scene.blend").partition("SAW")[2].splitlines()[0]
    )
    assert (saw["engine"], saw["first"], saw["transparent"]) == ("CYCLES", 0, True)
    assert saw["plate"] == f"//pictures/{frames[0].name}"
    assert saw["plates"] == len(frames)
    assert saw["catchers"] == 1
    pixels, _ = pixels_in_view(frames[0].view, placed.placement.position[None])
    assert saw["foot"] == pytest.approx(pixels[0], abs=0.01)


def test_usd_has_the_principal_point(scene: tuple[InsertionScene, PlacedObject], tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Gf, Usd, UsdGeom

    prepared, placed = scene
    shot = prepared.footage.frames[0]
    assert shot.view is not None
    view = replace(shot.view, camera=Camera("PINHOLE", 640, 480, np.array([500.0, 520.0, 250.0, 290.0])))
    frame = metric_transform([placed])
    write_usd_scene(tmp_path / "scene.usda", [placed], camera_keyframes([replace(shot, view=view)], frame), frame, 25.0)
    usd = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    frustum = UsdGeom.Camera(usd.GetPrimAtPath("/World/camera")).GetCamera(0).frustum
    x, y, _ = (frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()).Transform(Gf.Vec3d(0, 0, 0))
    pixels, _ = pixels_in_view(view, placed.placement.position[None])
    assert [320 * (1 + x), 240 * (1 - y)] == pytest.approx(pixels[0], abs=0.01)


def test_what_blender_draws_is_in_the_picture(scene: tuple[InsertionScene, PlacedObject], blender: Path) -> None:
    prepared, placed = scene
    environment = _environment(prepared, placed)
    shot = next(shot for shot in prepared.footage.frames if shot.view is not None)
    footage = prepared.footage.between(shot.index, shot.index)
    with traced_layers([placed], footage, prepared.content, environment) as traced:
        layer = traced(shot)
        asked = json.loads(blender.read_text())["job"]
        plate = read_exr(Path(asked["keys"][0]["plate"]))
    ((_, image),) = footage
    gain = measure_gain(image, prepared.content.at(shot).points, prepared.content.cloud)
    seen = np.dstack([srgb_to_linear(image) / gain, np.ones(image.shape[:2])])
    window = asked["window"]  # without distortion, the plate is the image with an empty margin
    assert plate.shape == (window["height"], window["width"], 4)
    assert (plate[0, :, 3] == 0).all()
    x, y = round(window["cx"] - 320), round(window["cy"] - 240)
    np.testing.assert_allclose(plate[y + 5 : y + 475, x + 5 : x + 635], seen[5:475, 5:635], atol=0.02)
    assert asked["samples"] == 32
    assert layer.shape == (480, 640, 4)
    np.testing.assert_allclose(layer[110:130, 215:245], np.broadcast_to([0.5, 0, 0, 1], (20, 30, 4)), atol=1e-3)


def test_glass_in_blender_shows_the_plate_of_its_frame(tmp_path: Path) -> None:
    """A pane of glass in front of a black world shows the plate of each key, and a support has its colours."""
    run_with_bpy("-c", "")
    glb = GltfWriter("test")
    surface = {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1.0}}}
    glb.use_extension("KHR_materials_transmission")
    glb.add("materials", surface | {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.0}})
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    part = {"attributes": {"POSITION": glb.add_accessor(corners, bounds=True)}, "material": 0}
    glb.add("meshes", {"primitives": [part]})
    (tmp_path / "pane.glb").write_bytes(glb.to_bytes([glb.add("nodes", {"mesh": 0})]))
    (tmp_path / "black.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n" + bytes(8))
    colours = np.array([[0.6, 0.2, 0.1], [0.1, 0.5, 0.3]], np.float32)
    matrix = np.eye(4)
    matrix[2, 3] = 3.0
    keys = [{"stem": f"{k}", "time_s": k, "matrix": matrix.tolist()} for k in range(2)]
    for key, colour in zip(keys, colours, strict=True):
        key["plate"] = str(tmp_path / f"plate{key['stem']}.exr")
        Path(key["plate"]).write_bytes(exr_bytes(np.tile(np.append(colour, 1.0), (32, 32, 1)).astype(np.float32)))
    job = {
        "objects": [{"file": str(tmp_path / "pane.glb"), "matrix": np.eye(4).tolist()}],
        "catchers": [],
        "environment": str(tmp_path / "black.hdr"),
        "window": {"width": 32, "height": 32, "fx": 32.0, "fy": 32.0, "cx": 16.0, "cy": 16.0},
        "keys": keys,
        "samples": 16,
        "out": str(tmp_path),
    }
    run_blender(job, tmp_path)
    for key, colour in zip(keys, colours, strict=True):
        layer = np.load(tmp_path / f"{key['stem']}.npy").astype(float)
        assert layer[12:20, 12:20, :3].mean(axis=(0, 1)) == pytest.approx(colour, rel=0.2)
        assert layer[16, 16, 3] == pytest.approx(1.0)


def test_without_blender_the_rest_is_exported(
    scene: tuple[InsertionScene, PlacedObject], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared, placed = scene
    monkeypatch.setenv("METRIC_TREE_BLENDER", str(tmp_path / "none"))
    (line,) = _export_blend(tmp_path, prepared, placed)
    assert "scene.blend is not written" in line


def test_values_of_a_glb_start_at_whole_words() -> None:
    glb = GltfWriter("test")
    glb.add_texture(np.full((3, 5, 4), 77, np.uint8))
    glb.add_accessor(np.arange(3.0), bounds=True)
    data = glb.to_bytes([])
    (size,) = struct.unpack_from("<I", data, 12)
    views = json.loads(data[20 : 20 + size])["bufferViews"]
    assert views[0]["byteLength"] % 4
    assert [view["byteOffset"] % 4 for view in views] == [0, 0]
    assert views[1]["byteOffset"] - views[0]["byteLength"] < 4
    for width in range(1, 9):  # images of all lengths, the last in the file
        glb = GltfWriter("test")
        glb.add_texture(np.random.default_rng(width).integers(0, 255, (3, width, 4), dtype=np.uint8))
        data = glb.to_bytes([])
        text, total = (struct.unpack_from("<I", data, place)[0] for place in (12, 8))
        (binary,) = struct.unpack_from("<I", data, 20 + text)
        assert (text % 4, binary % 4, total) == (0, 0, len(data))


def test_normals_of_a_slanted_plane_look_at_the_camera() -> None:
    normal = np.array([0.3, -0.4, -1.0]) / np.linalg.norm([0.3, -0.4, -1.0])
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 21), np.linspace(-0.3, 0.3, 15))
    rays = np.dstack([x, y]).astype(np.float32)
    depth = (-3 / (np.dstack([x, y, np.ones_like(x)]) @ normal)).astype(np.float32)
    assert np.allclose(surface_normals(depth, rays)[1:-1, 1:-1], normal, atol=0.02)


@pytest.mark.parametrize("azimuth", [0.0, 35.0, 200.0])
def test_the_studio_camera_looks_at_the_middle(azimuth: float) -> None:
    axes = camera_axes(azimuth, 20.0)
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1)
    assert axes[2][1] == pytest.approx(-np.sin(np.radians(20)))
