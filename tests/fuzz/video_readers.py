"""Readers of the inputs of `insert-object`, and of the evidence files of `estimate-scale`."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
from PIL import Image

from benchmarks.user_study.answers import ANSWERS_SCHEMA, read_answers
from benchmarks.user_study.curve import curve_of
from benchmarks.user_study.page import STEPS
from capture.sources.video import Video
from estimator.detectors.detector import load_detector
from estimator.evidence.gps import Gps
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Scene
from estimator.scene_formats.depth_files import read_depth
from insertion.scene.scale import read_scale
from metric_base.images import read_image
from models3d.gltf.model_reader import read_model
from models3d.model import Mesh
from tests.fuzz.reader import Reader
from tests.synthetic.detectors import paint_graph
from tests.synthetic.videos import times_of, write_video

__all__ = ["VIDEO_READERS", "write_video_seeds"]


def _model(folder: Path, _seeds: Path) -> None:
    for file in sorted(folder.glob("model*")):
        model = read_model(file)
        assert np.isfinite(model.extents).all(), "size is not finite"
        for part in model.meshes:
            _check_mesh(part)


def _check_mesh(part: Mesh) -> None:
    count, material = len(part.vertices), part.material
    assert not len(part.faces) or (part.faces.min() >= 0 and part.faces.max() < count), "face with an invalid vertex"
    assert part.normals.shape == part.vertices.shape, "vertices without normals"
    assert part.uv.shape == (count, 2), "vertices without texture coordinates"
    numbers = [*material.base_color, *material.emissive, material.metallic, material.roughness]
    assert len(numbers) == 9, "colour with a wrong number of channels"
    for values in (part.vertices, part.normals, part.uv, numbers):
        assert np.isfinite(values).all(), "number is not finite"


def _video(file: Path, _seeds: Path) -> None:
    video, last = Video(file), -np.inf
    for frame in video.frames():
        assert frame.colour.shape == (video.height, video.width, 3), "frame has another size than the video"
        assert last < frame.time_s < np.inf, "times do not increase"
        last = frame.time_s
        if frame.index >= 20:
            break


@cache
def _scene(folder: Path) -> Scene:
    return read_scene(folder, "none")


def _gps(folder: Path, seeds: Path) -> None:
    scene = _scene(seeds / "small" / "colmap")
    unmeasured: Any = SimpleNamespace(up=None)  # a scene without an up vector
    for source in (Gps(folder / "metres.csv"), Gps(folder / "degrees.csv"), Gps("exif", folder / "images")):
        for row in source.observe(scene, unmeasured):
            assert row.scale is None or (np.isfinite(row.scale) and row.scale > 0), "scale is not positive and finite"


def _depth(file: Path, _seeds: Path) -> None:
    assert read_depth(file).size, "empty depth map"


def _image(file: Path, _seeds: Path) -> None:
    for flags in (cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION, cv2.IMREAD_UNCHANGED):
        pixels = read_image(file, flags)
        assert pixels is None or pixels.size, "empty image"


def _answers(folder: Path, _seeds: Path) -> None:
    curve = curve_of(read_answers(folder / "answers.json"))
    assert np.isfinite([curve.observer.peak, curve.observer.noticeable]).all(), "curve is not finite"


def _scale(folder: Path, _seeds: Path) -> None:
    scale = read_scale(folder, None)
    assert 0 < scale.metres_per_unit < np.inf, "scale is not positive and finite"
    for bound in (scale.low, scale.high):
        assert bound is None or 0 < bound < np.inf, "interval is not positive and finite"


def _detector(folder: Path, _seeds: Path) -> None:
    detector = load_detector(folder / "paint.onnx", folder / "labels.txt")
    image = np.zeros((24, 32, 3), dtype=np.uint8)
    image[4:9, 5:9, 0] = 255
    result = detector(image)
    assert all(mask.shape == (24, 32) and mask.dtype == bool for mask in result.masks), "mask has a wrong shape"
    assert len(result.masks) == len(result.scores) == len(result.labels), "lists have different lengths"


VIDEO_READERS = (
    Reader("model", "models", ("model*", "*.bin", "*.png"), _model),
    Reader("video", "videos", ("video.*",), _video, alone=True),
    Reader("gps", "gps", ("*.csv", "images/*"), _gps),
    Reader("depth", "depth", ("depth.*",), _depth, alone=True),
    Reader("picture", "pictures", ("picture.*",), _image, alone=True),
    Reader("answers", "answers", ("answers.json",), _answers),
    Reader("scale-of-result", "result", ("result.json",), _scale),
    Reader("detector", "detector", ("*",), _detector),
)


def write_video_seeds(folder: Path, scene: Scene) -> None:
    """Write a folder of intact files in each format, with positions of the views of a scene."""
    for part in ("models", "videos", "gps", "depth", "answers", "result", "detector"):
        (folder / part).mkdir(parents=True)
    _write_models(folder / "models")
    images = [np.full((48, 64, 3), 12 * row, dtype=np.uint8) for row in range(8)]
    write_video(folder / "videos" / "video.mp4", images, times_of(8), turned_deg=90)
    write_video(folder / "videos" / "video.webm", images, times_of(8), codec="libvpx-vp9")
    _write_positions(folder / "gps", scene)
    depth = np.linspace(0.5, 3, 48).reshape(6, 8)
    np.save(folder / "depth" / "depth.npy", depth.astype(np.float32))
    (folder / "depth" / "depth.pfm").write_bytes(b"Pf\n8 6\n-1.0\n" + depth.astype("<f4").tobytes())
    cv2.imwrite(str(folder / "depth" / "depth.png"), np.round(depth * 1000).astype(np.uint16))
    rows = [{"step": step, "answer": ("too small", "right", "too large")[step % 3]} for step in STEPS]
    document = {"schema": ANSWERS_SCHEMA, "participant": "a", "answers": rows}
    (folder / "answers" / "answers.json").write_text(json.dumps(document))
    interval = {"level": 0.9, "low": 0.3, "high": 0.5}
    result = {"schema": "metric-tree/scale/1", "status": "resolved", "scale": 0.4, "interval": interval}
    (folder / "result" / "result.json").write_text(json.dumps(result))
    paint_graph(folder / "detector" / "paint.onnx")
    (folder / "detector" / "labels.txt").write_text("chair\ntable\n")


def _write_models(folder: Path) -> None:
    """Write a GLB file with a texture, and a glTF file with separate buffer and texture."""
    import trimesh

    box = trimesh.creation.box((0.4, 0.5, 0.6))
    texture = Image.fromarray(np.arange(192, dtype=np.uint8).reshape(8, 8, 3))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=texture, metallicFactor=0.1, roughnessFactor=0.8)
    box.visual = trimesh.visual.TextureVisuals(uv=box.vertices[:, :2], material=material)
    scene = trimesh.Scene(box)
    scene.add_geometry(
        box.copy(), transform=trimesh.transformations.translation_matrix([1, 0, 0]), parent_node_name=None
    )
    (folder / "model.glb").write_bytes(scene.export(file_type="glb"))
    for name, data in trimesh.Scene(box).export(file_type="gltf").items():
        (folder / (name if name != "model.gltf" else "model2.gltf")).write_bytes(data)


def _write_positions(folder: Path, scene: Scene) -> None:
    """Write tables in metres and in degrees, and images with EXIF positions, for the views of a scene."""
    (folder / "images").mkdir()
    metres = ["name,x,y,z"] + [f"{v.name},{','.join(map(str, 0.4 * v.centre))}" for v in scene.views]
    degrees = ["name,lat,lon,alt"]
    for view in scene.views:
        east, north, up = 1e-5 * view.centre
        degrees.append(f"{view.name},{48 + north},{16 + east},{200 + 1e5 * up}")
        exif = Image.Exif()
        exif[0x8825] = {
            1: "N",
            2: (48.0, 0.0, 30 + 3600 * north),
            3: "E",
            4: (16.0, 0.0, 30 + 3600 * east),
            5: b"\0",
            6: 200.0,
        }
        file = folder / "images" / view.name
        file.parent.mkdir(parents=True, exist_ok=True)
        Image.new("L", (8, 6)).save(file, exif=exif)
    (folder / "metres.csv").write_text("\n".join(metres))
    (folder / "degrees.csv").write_text("\n".join(degrees))
