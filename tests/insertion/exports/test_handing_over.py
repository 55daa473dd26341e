"""What other programs and people are handed: metric frames, lens maps, nearest layers, Blender's scenes."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from estimator.records.scene import Camera
from insertion.blender import job
from insertion.composite.compose import ObjectComposite
from insertion.exports import compositing
from insertion.exports.export_folder import LayerWriter
from insertion.exports.gltf_scene import write_gltf_scene
from insertion.exports.metric_frame import (
    CameraKeyframe,
    MetricTransform,
    camera_keyframes,
    frame_rate,
    keyframes_by_camera,
    metric_transform,
    object_matrix,
)
from insertion.footage.video_writer import matrix_of
from insertion.light.environment_map import HEIGHT, WIDTH, Environment
from insertion.render.layers import ObjectLayers
from insertion.render.renderer import ObjectImage
from insertion.scene.camera_rays import Window, camera_rays, surface_normals
from insertion.scene.pixel_box import PixelBox
from metric_base.images import read_image
from tests.insertion.composite.test_received import _view

# Published values, written out so that a changed rule fails a test.
IMAGE_SEQUENCE_RATE = 6.0

LENS = Camera("SIMPLE_RADIAL", 320, 240, np.array([280.0, 160.0, 120.0, -0.15]))


def _shots(times: list[float]) -> list[Any]:
    return [SimpleNamespace(clock_s=time, name=f"{k}.png", view=None, index=k) for k, time in enumerate(times)]


def test_the_metric_frame_has_metres_and_up() -> None:
    place: Any = SimpleNamespace(basis=np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), position=np.array([1.0, 2, 3]))
    transform = metric_transform([SimpleNamespace(placement=place, metres_per_unit=0.5)])  # type: ignore[list-item]
    assert transform(np.array([[1.0, 2, 3], [1, 4, 3], [1, 2, 5], [3, 2, 3]])) == pytest.approx(
        np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, -1]])
    )
    view = _view()
    shots = _shots([0.5, 3.0])
    shots[1].view = view
    (key,) = camera_keyframes(shots, transform)  # the first frame has no pose
    assert (key.name, key.time_s, key.camera) == ("1.png", 2.5, view.camera)
    assert key.matrix[:3, 3] == pytest.approx(transform(view.centre[None])[0])
    ahead = transform.rotation @ view.rotation[2]
    assert key.matrix[:3, :3] @ [0, 0, -1] == pytest.approx(ahead)
    assert key.matrix[:3, :3] @ [0, -1, 0] == pytest.approx(transform.rotation @ view.rotation[1])
    assert key.matrix[3].tolist() == [0, 0, 0, 1]
    model = SimpleNamespace(bounds=np.array([[0.0, 1, 0], [2, 5, 4]]))
    placed: Any = SimpleNamespace(
        playback=None, model=model, size=SimpleNamespace(factor=2.0), turn=transform.rotation.T, placement=place
    )
    matrix = object_matrix(placed, transform)
    assert matrix @ [1, 1, 2, 1] == pytest.approx([0, 0, 0, 1])
    assert matrix @ [1, 2, 2, 1] == pytest.approx([0, 2, 0, 1])


def test_a_rate_is_the_usual_one_and_lenses_of_one_kind_are_one() -> None:
    assert frame_rate(_shots([3.0, 3.1, 3.2, 3.4])) == pytest.approx(10)
    assert frame_rate(_shots([1.0])) == IMAGE_SEQUENCE_RATE
    assert frame_rate(_shots([1.0, 1.0])) == IMAGE_SEQUENCE_RATE
    other = Camera("PINHOLE", 320, 240, np.array([280.0, 280, 160, 120]))
    keys: Any = [
        SimpleNamespace(camera=camera, name=name) for name, camera in zip("abc", (LENS, other, LENS), strict=True)
    ]
    assert [(lens, [key.name for key in own]) for lens, own in keyframes_by_camera(keys)] == [
        (LENS, ["a", "c"]),
        (other, ["b"]),
    ]


def test_the_maps_of_a_lens_are_each_other_s_inverse() -> None:
    there, back = compositing.lens_maps(LENS)
    assert there.shape == (240, 320, 3)
    for row, column in ((20, 30), (120, 160), (230, 5)):
        x, y = there[row, column, :2]
        at = back[int(y), int(x)]
        assert at == pytest.approx([column, row], abs=1.0)  # within the pixel of the straight plate
    assert there[120, 160, :2] - there[119, 159, :2] == pytest.approx([1, 1], abs=0.01)
    flat = compositing.lens_maps(Camera("PINHOLE", 64, 48, np.array([64.0, 64, 32, 24])))
    middle = flat[0][24, 32, :2]
    assert flat[1][int(middle[1]), int(middle[0])] == pytest.approx([32, 24], abs=1e-3)
    assert (middle % 1).tolist() == [0.5, 0.5]


def _joined(box: PixelBox, depth: float, hidden: float) -> ObjectComposite:
    alpha = np.full(box.shape, 0.5, np.float32)
    image = ObjectImage(np.zeros((*box.shape, 3), np.float32), alpha, np.full(box.shape, depth, np.float32))
    layers = ObjectLayers(box, image, np.ones((*box.shape, 3), np.float32), alpha)
    return ObjectComposite(layers, np.full(box.shape, hidden, np.float32), np.ones((*box.shape, 3), np.float32))


def _writer(folder: Path, frames: list[Any], metres: float = 2.0) -> compositing.CompositingLayers:
    return compositing.CompositingLayers(folder, [], frames, metres)


def test_layers_of_the_nearest_object(tmp_path: Path) -> None:
    writer = _writer(tmp_path, _shots([0.0]))
    shot = _shots([0.0])[0]
    writer.layers(shot, 0, _joined(PixelBox(0, 0, 6, 4), 3.0, 0.2))
    writer.layers(shot, 1, _joined(PixelBox(4, 2, 9, 8), 2.0, 0.7))
    depth, hidden, number = writer._nearest((8, 10))
    assert (depth[1, 1], depth[3, 5], depth[6, 6]) == (3, 2, 2)
    assert np.isinf(depth[0, 9])
    assert [hidden[1, 1], hidden[3, 5], hidden[0, 9]] == pytest.approx([0.2, 0.7, 0.0])
    assert (number[1, 1], number[3, 5], number[0, 9]) == (1, 2, 0)
    shares = writer._shares((8, 10))  # visible coverage 0.4 and 0.15
    assert shares[1] + shares[2] == pytest.approx(1.0, abs=1e-5)
    assert [shares[1][1, 1], shares[1][3, 5], shares[1][6, 6]] == pytest.approx([1.0, 0.4 / 0.55, 0.0], abs=0.01)


def test_normals_of_a_depth_face_the_camera() -> None:
    camera = Camera("PINHOLE", 64, 48, np.array([64.0, 64, 32, 24]))
    rays = camera_rays(camera)
    normal = np.array([0.6, 0.0, -0.8])
    depth = (-1.6 / (rays @ normal[:2] + normal[2])).astype(np.float32)
    assert surface_normals(depth, rays)[5:-5, 5:-5] == pytest.approx(np.broadcast_to(normal, (38, 54, 3)), abs=2e-3)
    unknown = surface_normals(np.full((48, 64), np.inf, np.float32), rays)
    assert not unknown.any()


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_an_exr_has_its_channels_in_their_order(tmp_path: Path, channels: int) -> None:
    import av

    pixels = np.random.default_rng(0).uniform(0, 1, (10, 14, channels)).astype(np.float32)
    (tmp_path / "a.exr").write_bytes(compositing.exr_bytes(pixels if channels > 1 else pixels[..., 0], half=False))
    with av.open(str(tmp_path / "a.exr")) as container:
        transform = next(container.decode(video=0))
    order = {1: [0], 3: [1, 2, 0], 4: [1, 2, 0, 3]}[channels]
    for plane, channel in zip(transform.planes, order, strict=True):
        rows = np.frombuffer(memoryview(plane), np.float32).reshape(10, -1)[:, :14]
        assert rows == pytest.approx(pixels[..., channel], abs=1e-7)


def test_depth_is_in_millimetres_of_sixteen_bits(tmp_path: Path) -> None:
    (shot,) = _shots([0.0])
    writer = LayerWriter(tmp_path, [shot], 0.5)
    writer.plate(shot, np.full((8, 10, 3), (10, 20, 30), np.uint8))
    writer.layers(shot, 2, _joined(PixelBox(2, 1, 6, 5), 3.0, 0.5))
    depth, mask = (read_image(tmp_path / name / "0_3.png", -1) for name in ("depth", "mask"))
    assert depth is not None
    assert mask is not None
    assert (depth.dtype, int(depth[2, 3]), int(depth[0, 0]), int(mask[2, 3])) == (np.uint16, 1500, 0, 64)
    writer.layers(shot, 3, _joined(PixelBox(2, 1, 6, 5), 131.08, 0.0))
    far = read_image(tmp_path / "depth" / "0_4.png", -1)
    assert far is not None
    assert not far.any()
    writer.layers(shot, 4, _joined(PixelBox(2, 1, 6, 5), 131.07, 0.0))
    farthest = read_image(tmp_path / "depth" / "0_5.png", -1)
    assert farthest is not None
    assert farthest.max() == 65_535
    plain = read_image(tmp_path / "pictures" / "0.png", -1)
    assert plain is not None
    assert plain[0, 0].tolist() == [30, 20, 10]


def test_a_catcher_is_under_each_level_and_reflects_what_is_below() -> None:
    transform = MetricTransform(0.5, np.eye(3)[[0, 2, 1]], np.zeros(3))

    def item(x: float, height: float, unit: float, plane: int = 0, surface: Any = None) -> Any:
        place = SimpleNamespace(basis=np.eye(3), position=np.array([x, 0.0, height]), plane=plane)
        return SimpleNamespace(placement=place, body=SimpleNamespace(unit=unit), surface=surface)

    (corners,) = job.catcher_corners([item(0.0, 1.0, 0.2), item(1.0, 1.004, 0.1)], transform)
    assert corners[:, 0].min() == pytest.approx(-0.5 * 8 * 0.2)
    assert corners[:, 0].max() == pytest.approx(0.5 * 1.8)
    assert corners[:, 1] == pytest.approx([0.5] * 4)
    assert corners[:, 2] == pytest.approx(0.5 * np.array([-1.6, -1.6, 1.6, 1.6]))
    solid = np.zeros((10, 10), bool)
    solid[2:5, 3:9] = True
    table = SimpleNamespace(solid=solid, origin=np.array([-1.0, -1.0]), cell=0.2)
    ends = job.catcher_corners([item(0.0, 1.0, 1.0, 1, table)], transform)[0]
    assert ends[:, 0].min() == pytest.approx(0.5 * -0.6)
    assert ends[:, 0].max() == pytest.approx(0.5 * 0.0)
    assert ends[:, 2].max() == pytest.approx(0.5 * 0.8)
    high, low = item(0.0, 1.0, 0.2), item(0.6, 0.9, 0.4)

    def reaches(*items: Any) -> list[float]:
        """Half the width of the catcher of each object in scene units."""
        corners = job.catcher_corners(items, transform)
        return [float(np.ptp(one[:, 0])) / transform.scale / 2 for one in corners]

    assert reaches(high, low) == pytest.approx([0.4, 3.2])  # only the higher one is limited
    assert reaches(item(0.0, 1.0, 0.3), item(0.1, 0.9, 0.4)) == pytest.approx([0.15, 3.2])  # half of its size
    assert reaches(high, item(0.6, 0.2, 0.4)) == pytest.approx([0.4, 3.2])  # seen from above, it was cut too
    # the common catcher of two objects would be above the lower one between them
    assert reaches(high, item(4.0, 1.0, 0.2), item(2.0, 0.9, 0.4)) == pytest.approx([1.6, 1.6, 3.2])
    radiance = np.full((HEIGHT, WIDTH, 3), 2.0, np.float32)
    radiance[HEIGHT // 2 :] = (1.0, 0.5, 0.01)
    lit = Environment(radiance, np.eye(3), np.ones((HEIGHT, WIDTH), np.float32))
    assert job.support_albedo(lit)["albedo"] == pytest.approx([0.5, 0.25, 0.05], rel=0.01)
    assert job.support_albedo(lit)["albedo_per_radiance"] == pytest.approx([0.5] * 3, rel=0.01)
    assert job._window(Window(100.0, 110.0, 50.0, 40.0, -5, 3, 90, 70)) == {
        "width": 90, "height": 70, "fx": 100.0, "fy": 110.0, "cx": 55.0, "cy": 37.0,
    }  # fmt: skip


def test_rotations_of_a_camera_take_the_shorter_way(tmp_path: Path) -> None:
    from scipy.spatial.transform import Rotation

    keys = []
    for index, angle in enumerate((150.0, 170.0, 190.0, 210.0, 350.0)):
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_euler("y", angle, degrees=True).as_matrix()
        keys.append(CameraKeyframe(f"{index}.png", float(index), LENS, matrix))
    write_gltf_scene(tmp_path / "a.glb", [], keys, MetricTransform(1.0, np.eye(3), np.zeros(3)))
    data = (tmp_path / "a.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    document, body = json.loads(data[20 : 20 + length]), data[28 + length :]
    view = document["bufferViews"][
        document["accessors"][document["animations"][0]["samplers"][1]["output"]]["bufferView"]
    ]
    start = view.get("byteOffset", 0)
    turns = np.frombuffer(body[start : start + view["byteLength"]], np.float32).reshape(-1, 4)
    assert len(turns) == len(keys)
    assert ((turns[1:] * turns[:-1]).sum(axis=1) > 0).all()
    assert Rotation.from_quat(turns).as_matrix() == pytest.approx(
        np.array([key.matrix[:3, :3] for key in keys]), abs=1e-6
    )


@pytest.fixture
def blender(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The two scripts that Blender runs, with a recorder in Blender's place."""
    bpy, mathutils = MagicMock(), MagicMock()
    mathutils.Matrix.side_effect = np.array
    for name, module in (("bpy", bpy), ("mathutils", mathutils)):
        monkeypatch.setitem(sys.modules, name, module)
    folder = Path(job.__file__).parent
    scripts = {}
    for name, file in (("script", "script.py"), ("layer_script", "layer_script.py")):
        spec = importlib.util.spec_from_file_location(name, folder / file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, name, module)
        spec.loader.exec_module(module)
        scripts[name] = module
    return SimpleNamespace(bpy=bpy, **scripts)


WINDOW = {"width": 200, "height": 120, "fx": 150.0, "fy": 180.0, "cx": 90.0, "cy": 70.0}


def test_a_card_fills_the_camera_s_picture(blender: Any) -> None:
    blender.layer_script.add_card(MagicMock(), MagicMock(), {"window": WINDOW, "first": 1, "last": 3})
    corners = np.array(blender.bpy.data.meshes.new.return_value.from_pydata.call_args.args[0])
    x = WINDOW["cx"] + WINDOW["fx"] * corners[:, 0] / -corners[:, 2]
    y = WINDOW["cy"] - WINDOW["fy"] * corners[:, 1] / -corners[:, 2]
    assert np.column_stack([x, y]) == pytest.approx(np.array([[0, 120], [200, 120], [200, 0], [0, 0]]), abs=1e-9)


def test_a_lens_is_that_of_the_window(blender: Any) -> None:
    scene, data = SimpleNamespace(render=SimpleNamespace()), SimpleNamespace()
    blender.script.set_lens(scene, data, WINDOW)
    assert data.lens == pytest.approx(36.0 * 150 / 200)
    assert data.shift_x == pytest.approx(10 / 200)
    assert data.shift_y == pytest.approx(10 / 200 * 150 / 180)
    assert (scene.render.pixel_aspect_x, scene.render.pixel_aspect_y) == pytest.approx((180 / 150, 1.0))
    assert (scene.render.resolution_x, scene.render.resolution_y) == (200, 120)


def test_keys_are_at_their_frames(blender: Any) -> None:
    scene = SimpleNamespace(render=SimpleNamespace(), collection=MagicMock())
    camera = blender.bpy.data.objects.new.return_value
    keys = [{"time_s": time, "matrix": np.eye(4).tolist(), "window": WINDOW} for time in (1.0, 1.5, 2.0)]
    blender.script.add_camera(scene, {"keys": keys, "window": WINDOW, "rate": 24.0, "start_s": 0.5})
    frames = [call.kwargs["frame"] for call in camera.keyframe_insert.call_args_list]
    assert frames == [12, 12, 24, 24, 36, 36]
    assert (scene.frame_start, scene.frame_end, scene.render.fps / scene.render.fps_base) == (0, 36, pytest.approx(24))
    assert not blender.bpy.data.cameras.new.return_value.keyframe_insert.called
    zoomed = [*keys[:2], keys[2] | {"window": WINDOW | {"fx": 140.0}}]
    blender.script.add_camera(scene, {"keys": zoomed, "window": WINDOW, "rate": 29.97})
    assert scene.render.fps == 30
    assert scene.render.fps / scene.render.fps_base == pytest.approx(29.97)
    assert blender.bpy.data.cameras.new.return_value.keyframe_insert.call_count == 9
    output = MagicMock()
    output.name = "objects"
    blender.layer_script.set_output(output, {"first": 3, "last": 9, "rate": 29.97, "samples": 32})
    assert (output.frame_start, output.frame_end, output.cycles.samples) == (3, 9, 32)
    assert output.render.fps / output.render.fps_base == pytest.approx(29.97)


def test_luma_and_chroma_of_a_matrix() -> None:
    for number, red, blue in ((1, 0.2126, 0.0722), (9, 0.2627, 0.0593), (2, 0.299, 0.114)):
        matrix = matrix_of(number)
        assert matrix[0] == pytest.approx([red, 1 - red - blue, blue])
        assert matrix @ np.ones(3) == pytest.approx([1, 0, 0])
        assert matrix @ [0, 0, 1] == pytest.approx([blue, 0.5, -0.5 * blue / (1 - red)])
        assert matrix @ [1, 0, 0] == pytest.approx([red, -0.5 * red / (1 - blue), 0.5])
