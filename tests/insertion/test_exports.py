"""The exports say where the camera and the object are, in metres."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from insertion.blender.tracing import export_blend, traced_layers
from insertion.exports.gltf_scene import write_gltf_scene
from insertion.exports.metric_frame import camera_keys, metric_frame, object_matrix
from insertion.exports.nerfstudio import write_transforms
from insertion.exports.usd_scene import write_usd_scene
from insertion.light.estimate import environment_at
from insertion.staging.insert import Placed, place_objects
from insertion.staging.options import ObjectRequest
from insertion.staging.stage import Stage
from tests.made.insertions import film_room, stage_of, write_glb
from tests.made.rooms.shapes import solid

HEIGHT = 0.8


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[Stage, Placed]:
    room = film_room("bedroom", 1001, tmp_path_factory.mktemp("room"), views=4)
    stage = stage_of(room)
    model = write_glb(solid("chair", np.array([0.4, 0.4, HEIGHT])), room.folder / "chair.glb")
    return stage, place_objects(stage, [ObjectRequest(model, facing=30.0)])[0]


def _pixel(matrix: np.ndarray, focal: float, centre: tuple[float, float], point: np.ndarray) -> np.ndarray:
    """A point of the metric frame through an OpenGL camera."""
    local = np.linalg.inv(matrix) @ np.append(point, 1.0)
    return np.array([centre[0] + focal * local[0] / -local[2], centre[1] - focal * local[1] / -local[2]])


def test_a_metric_camera_sees_the_foot_where_the_scene_does(scene: tuple[Stage, Placed]) -> None:
    stage, placed = scene
    frame = metric_frame([placed], stage.scale.metres_per_unit)
    for shot, key in zip(stage.footage.shots, camera_keys(stage.footage.shots, frame), strict=True):
        view = shot.view
        assert view is not None
        local = view.rotation @ placed.place.position + view.translation
        pixel = view.camera.params[0] * local[:2] / local[2] + view.camera.params[2:]
        top = placed.place.position + placed.place.basis[2] * HEIGHT / stage.scale.metres_per_unit
        assert _pixel(key.matrix, 500.0, (320.0, 240.0), np.zeros(3)) == pytest.approx(pixel, abs=1e-6)
        assert frame(top[None])[0] == pytest.approx([0, HEIGHT, 0], abs=1e-9)


def test_the_model_has_its_metres(scene: tuple[Stage, Placed]) -> None:
    stage, placed = scene
    matrix = object_matrix(placed, metric_frame([placed], stage.scale.metres_per_unit))
    corners = np.concatenate([part.vertices for part in placed.model.parts]) @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)
    assert corners[:, 1].min() == pytest.approx(0, abs=1e-6)
    assert corners[:, 1].max() == pytest.approx(HEIGHT, abs=1e-5)


def test_glb_has_an_animated_camera(scene: tuple[Stage, Placed], tmp_path: Path) -> None:
    import trimesh

    stage, placed = scene
    frame = metric_frame([placed], stage.scale.metres_per_unit)
    keys = camera_keys(stage.footage.shots, frame)
    write_gltf_scene(tmp_path / "scene.glb", [placed], keys, stage.scene.views[0].camera, frame)
    data = (tmp_path / "scene.glb").read_bytes()
    header = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    assert header["cameras"][0]["perspective"]["yfov"] == pytest.approx(2 * np.arctan(240 / 500))
    assert header["accessors"][header["animations"][0]["samplers"][0]["input"]]["count"] == len(keys)
    extents = trimesh.load_scene(tmp_path / "scene.glb").extents
    assert extents[1] == pytest.approx(HEIGHT, rel=1e-4)


def test_usd_has_the_same_camera(scene: tuple[Stage, Placed], tmp_path: Path) -> None:
    pxr = pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd, UsdGeom

    assert pxr is not None
    stage, placed = scene
    frame = metric_frame([placed], stage.scale.metres_per_unit)
    keys = camera_keys(stage.footage.shots, frame)
    write_usd_scene(tmp_path / "scene.usda", [placed], keys, stage.scene.views[0].camera, frame)
    usd = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    assert UsdGeom.GetStageMetersPerUnit(usd) == 1.0
    camera = UsdGeom.Xformable(usd.GetPrimAtPath("/World/camera"))
    for key in keys:
        matrix = np.array(camera.ComputeLocalToWorldTransform(key.time_s * 1000)).T
        assert matrix == pytest.approx(key.matrix, abs=1e-9)
    bounds = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(
        usd.GetPrimAtPath("/World/object0")
    )
    assert bounds.ComputeAlignedRange().GetSize()[1] == pytest.approx(HEIGHT, rel=1e-4)


def test_nerfstudio_counts_pixels_from_the_first_centre(scene: tuple[Stage, Placed], tmp_path: Path) -> None:
    stage, placed = scene
    keys = camera_keys(stage.footage.shots, metric_frame([placed], stage.scale.metres_per_unit))
    write_transforms(tmp_path / "transforms.json", keys, stage.scene.views[0].camera, "pictures")
    document = json.loads((tmp_path / "transforms.json").read_text())
    assert (document["cx"], document["cy"], document["fl_x"]) == (319.5, 239.5, 500.0)
    for frame, key in zip(document["frames"], keys, strict=True):
        matrix = np.array(frame["transform_matrix"])
        assert matrix[2, 3] == pytest.approx(key.matrix[1, 3])  # height along +z
        assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)


#: Stands in for Blender: keeps its arguments, compiles the script, and writes what the job asks for.
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
    """The file in which a Blender that only records says what it was asked."""
    program = tmp_path / "blender"
    program.write_text(BLENDER.format(python=sys.executable, record=tmp_path / "asked.json"))
    program.chmod(0o755)
    monkeypatch.setenv("METRIC_TREE_BLENDER", str(program))
    return tmp_path / "asked.json"


def test_blender_is_asked_for_the_scene_in_metres(scene: tuple[Stage, Placed], blender: Path, tmp_path: Path) -> None:
    stage, placed = scene
    assert export_blend(tmp_path, stage, [placed]) == []
    assert (tmp_path / "scene.blend").read_bytes() == b"BLENDER"
    asked = json.loads(blender.read_text())
    assert asked["words"][:3] == ["--background", "--factory-startup", "--python"]
    assert asked["words"][-2] == "--"
    frame = metric_frame([placed], stage.scale.metres_per_unit)
    keys = camera_keys(stage.footage.shots, frame)
    for stated, key in zip(asked["job"]["keys"], keys, strict=True):
        np.testing.assert_allclose(stated["matrix"], key.matrix)
    np.testing.assert_allclose(asked["job"]["objects"][0]["matrix"], object_matrix(placed, frame))


#: Run by the Python that has bpy: what a saved scene holds.
OPENED = """
import json, sys, bpy, numpy as np
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
meshes = [thing for thing in bpy.data.objects if thing.type == "MESH" and not thing.is_shadow_catcher]
corners = np.array([thing.matrix_world @ vertex.co for thing in meshes for vertex in thing.data.vertices])
scene = bpy.context.scene
print("SAW" + json.dumps({
    "height": float(np.ptp(corners[:, 2])), "lowest": float(corners[:, 2].min()),
    "packed": [image.packed_file is not None for image in bpy.data.images if image.source == "FILE"],
    "catchers": sum(thing.is_shadow_catcher for thing in bpy.data.objects if thing.type == "MESH"),
    "moves": scene.camera.animation_data is not None and scene.frame_end > scene.frame_start,
}))
"""


def test_the_real_blender_saves_the_object_in_metres(scene: tuple[Stage, Placed], tmp_path: Path) -> None:
    program = os.environ.get("METRIC_TREE_BLENDER", "")
    if "python" not in Path(program).name:
        pytest.skip("METRIC_TREE_BLENDER names no Python with bpy (pip install bpy)")
    stage, placed = scene
    assert export_blend(tmp_path, stage, [placed]) == []
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    words = [program, "-c", OPENED, str(tmp_path / "scene.blend")]
    said = subprocess.run(words, capture_output=True, text=True, env=clean, check=True).stdout
    saw = json.loads(said.partition("SAW")[2].splitlines()[0])
    assert saw["height"] == pytest.approx(placed.size_m["height"], rel=1e-4)
    assert saw["lowest"] == pytest.approx(0.0, abs=1e-5)
    assert (saw["packed"], saw["catchers"], saw["moves"]) == ([True], 1, True)


def test_what_blender_draws_is_in_the_picture(scene: tuple[Stage, Placed], blender: Path) -> None:
    stage, placed = scene
    environment = environment_at(placed.place, HEIGHT, stage.cloud, stage.stills)
    shot = next(shot for shot in stage.footage.shots if shot.view is not None)
    with traced_layers(stage, [placed], environment) as traced:
        layer = traced(shot)
    assert json.loads(blender.read_text())["job"]["samples"] > 0
    assert layer.shape == (480, 640, 4)
    np.testing.assert_allclose(layer[110:130, 215:245], np.broadcast_to([0.5, 0, 0, 1], (20, 30, 4)), atol=1e-3)


def test_without_blender_the_rest_is_exported(
    scene: tuple[Stage, Placed], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage, placed = scene
    monkeypatch.setenv("METRIC_TREE_BLENDER", str(tmp_path / "none"))
    (line,) = export_blend(tmp_path, stage, [placed])
    assert "scene.blend is not written" in line
