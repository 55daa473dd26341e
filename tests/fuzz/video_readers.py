"""The readers of what `insert-object` and the other evidence of `estimate-scale` are given."""

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
from estimator.evidence.depth_maps import read_depth
from estimator.evidence.gps import Gps
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Scene
from insertion.scene.scale import read_scale
from metric_base.images import read_picture
from models3d.gltf.model_reader import read_model
from models3d.model import Mesh
from tests.fuzz.reader import Reader
from tests.synthetic.detectors import paint_graph
from tests.synthetic.videos import times_of, write_video

__all__ = ["VIDEO_READERS", "write_video_seeds"]


def _model(folder: Path, _seeds: Path) -> None:
    for file in sorted(folder.glob("model*")):
        model = read_model(file)
        assert np.isfinite(model.extents).all(), "a size that is not finite"
        for part in model.meshes:
            _check_part(part)


def _check_part(part: Mesh) -> None:
    count, material = len(part.vertices), part.material
    assert not len(part.faces) or (part.faces.min() >= 0 and part.faces.max() < count), "a face without corners"
    assert part.normals.shape == part.vertices.shape, "corners without normals"
    assert part.uv.shape == (count, 2), "corners without texture coordinates"
    numbers = [*material.base_color, *material.emissive, material.metallic, material.roughness]
    assert len(numbers) == 9, "a colour of another length"
    for values in (part.vertices, part.normals, part.uv, numbers):
        assert np.isfinite(values).all(), "a number that is not finite"


def _video(file: Path, _seeds: Path) -> None:
    video, last = Video(file), -np.inf
    for frame in video.frames():
        assert frame.colour.shape == (video.height, video.width, 3), "a frame of another size"
        assert last < frame.time_s < np.inf, "a time that does not grow"
        last = frame.time_s
        if frame.index >= 20:
            break


@cache
def _scene(folder: Path) -> Scene:
    return read_scene(folder, "none")


def _gps(folder: Path, seeds: Path) -> None:
    scene = _scene(seeds / "small" / "colmap")
    unmeasured: Any = SimpleNamespace(up=None)  # that the scene says nothing of up
    for source in (Gps(folder / "metres.csv"), Gps(folder / "degrees.csv"), Gps("exif", folder / "images")):
        for row in source.observe(scene, unmeasured):
            assert row.scale is None or (np.isfinite(row.scale) and row.scale > 0), "a scale that is none"


def _depth(file: Path, _seeds: Path) -> None:
    assert read_depth(file).size, "an empty map"


def _picture(file: Path, _seeds: Path) -> None:
    for flags in (cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION, cv2.IMREAD_UNCHANGED):
        pixels = read_picture(file, flags)
        assert pixels is None or pixels.size, "an empty picture"


def _answers(folder: Path, _seeds: Path) -> None:
    curve = curve_of(read_answers(folder / "answers.json"))
    assert np.isfinite([curve.observer.peak, curve.observer.noticeable]).all(), "a curve that is none"


def _scale(folder: Path, _seeds: Path) -> None:
    scale = read_scale(folder, None)
    assert 0 < scale.metres_per_unit < np.inf, "a scale that is none"
    for bound in (scale.low, scale.high):
        assert bound is None or 0 < bound < np.inf, "an interval that is none"


def _detector(folder: Path, _seeds: Path) -> None:
    detector = load_detector(folder / "paint.onnx", folder / "labels.txt")
    picture = np.zeros((24, 32, 3), dtype=np.uint8)
    picture[4:9, 5:9, 0] = 255
    seen = detector(picture)
    assert all(mask.shape == (24, 32) and mask.dtype == bool for mask in seen.masks), "a mask of another size"
    assert len(seen.masks) == len(seen.scores) == len(seen.labels), "lists of different lengths"


VIDEO_READERS = (
    Reader("model", "models", ("model*", "*.bin", "*.png"), _model),
    Reader("video", "videos", ("video.*",), _video, alone=True),
    Reader("gps", "gps", ("*.csv", "images/*"), _gps),
    Reader("depth", "depth", ("depth.*",), _depth, alone=True),
    Reader("picture", "pictures", ("picture.*",), _picture, alone=True),
    Reader("answers", "answers", ("answers.json",), _answers),
    Reader("scale-of-result", "result", ("result.json",), _scale),
    Reader("detector", "detector", ("*",), _detector),
)


def write_video_seeds(folder: Path, scene: Scene) -> None:
    """A whole folder of each form; scene : whose views the positions are of."""
    for part in ("models", "videos", "gps", "depth", "answers", "result", "detector"):
        (folder / part).mkdir(parents=True)
    _write_models(folder / "models")
    pictures = [np.full((48, 64, 3), 12 * row, dtype=np.uint8) for row in range(8)]
    write_video(folder / "videos" / "video.mp4", pictures, times_of(8), turned_deg=90)
    write_video(folder / "videos" / "video.webm", pictures, times_of(8), codec="libvpx-vp9")
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
    """A GLB with a texture, and a glTF with its buffer and its texture beside it."""
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
    """Tables of metres and of degrees, and pictures with EXIF, for the views of a scene."""
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
