"""The fuzzed readers, and intact files of each format as seeds."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from estimator.evidence.known_lengths import parse_known_lengths
from estimator.instances.instance_reader import read_instance_files
from estimator.outputs.ground_truth import read_truth
from estimator.reconstructions.objects_file import SCHEMA, read_objects
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Instance, Scene
from tests.fuzz.reader import Reader
from tests.fuzz.video_readers import VIDEO_READERS, write_video_seeds
from tests.fuzz.web_readers import WEB_READERS, write_web_seeds
from tests.synthetic.exports import EXPORTS, write_export
from tests.synthetic.small_scene import small_model, write_small_scene

__all__ = ["READERS", "Reader", "write_seeds"]


def _scene(folder: Path, _seeds: Path) -> None:
    check_scene(read_scene(folder))


def check_scene(scene: Scene) -> None:
    """Assert that an accepted scene has finite numbers and valid rotations."""
    assert np.isfinite(scene.points).all(), "points are not finite"
    for view in scene.views:
        assert np.isfinite(view.rotation).all(), "rotation is not finite"
        assert np.isfinite(view.translation).all(), "translation is not finite"
        assert abs(np.linalg.det(view.rotation) - 1) < 0.1, "rotation has a determinant other than 1"
        assert np.isfinite(view.keypoints).all(), "keypoints are not finite"
    if scene.dense is not None:
        assert np.isfinite(scene.dense.points).all(), "dense cloud is not finite"


def _instances(name: str) -> Callable[[Path, Path], None]:
    def read(folder: Path, seeds: Path) -> None:
        scene = read_scene(seeds / "small" / "colmap", "none")
        instances, _ = read_instance_files(scene, folder / name if name else folder)
        for instance in instances:
            check_instance(scene, instance)

    return read


def check_instance(scene: Scene, instance: Instance) -> None:
    """Assert that an accepted instance is inside its image and has a category and a valid score."""
    camera = scene.views[instance.view].camera
    height, width = instance.mask.shape
    assert instance.mask.any(), "empty mask"
    assert 0 <= instance.origin[0] <= camera.width - width, "mask outside its image"
    assert 0 <= instance.origin[1] <= camera.height - height, "mask outside its image"
    assert instance.category.strip(), "no category"
    assert 0 <= instance.score <= 1, "score outside 0 to 1"


def _objects(folder: Path, _seeds: Path) -> None:
    for item in read_objects(folder / "objects.json"):
        sizes = item.extents[~np.isnan(item.extents)]
        assert ((sizes > 0) & np.isfinite(sizes)).all(), "size is not positive and finite"


def _lengths(folder: Path, _seeds: Path) -> None:
    for length in parse_known_lengths([str(folder / "lengths.txt")]):
        assert np.isfinite(length.log_scale), "length is not positive and finite"


def _truth(folder: Path, _seeds: Path) -> None:
    read_truth(folder)


_EXPORT_FILES = {
    "nerfstudio": ("transforms.json", "sparse_pc.ply"),
    "bundler": ("bundle.out", "bundle.list.txt"),
    "metashape": ("cameras.xml", "points.ply"),
    "realitycapture": ("registration.csv", "points.ply"),
    "meshroom": ("cameras.sfm",),
}

READERS = (
    Reader("colmap-binary", "small/colmap", ("cameras.bin", "images.bin", "points3D.bin"), _scene),
    Reader("colmap-text", "small/text", ("cameras.txt", "images.txt", "points3D.txt"), _scene),
    Reader("dense", "small/colmap", ("dense.ply", "dense.ply.vis"), _scene),
    Reader("opensfm", "small/opensfm", ("reconstruction.json", "tracks.csv"), _scene),
    *(Reader(program, program, _EXPORT_FILES[program], _scene) for program in EXPORTS),
    Reader("coco", "small/colmap", ("instances.json",), _instances("instances.json")),
    Reader("results", "small/colmap", ("results.json", "results_categories.json"), _instances("results.json")),
    Reader("label-images", "small/opensfm/instances", ("categories.json", "*.png"), _instances("")),
    Reader("yolo", "yolo", ("data.yaml", "labels/*.txt"), _instances("")),
    Reader("labelme", "labelme", ("*.json",), _instances("")),
    Reader("npz", "npz", ("*.npz", "labels.json"), _instances("")),
    Reader("objects", "objects", ("objects.json",), _objects),
    Reader("known-lengths", "objects", ("lengths.txt",), _lengths),
    Reader("truth", "objects", ("truth.json",), _truth),
    *VIDEO_READERS,
    *WEB_READERS,
)


def write_seeds(folder: Path) -> None:
    """Write a folder of intact files in each format."""
    write_small_scene(folder / "small", small_model())
    scene = read_scene(folder / "small" / "colmap", "none")
    for program in EXPORTS:
        write_export(scene, program, folder / program)
    stems = [Path(view.name).stem for view in scene.views[:2]]
    for part in ("yolo/labels", "labelme", "npz", "objects"):
        (folder / part).mkdir(parents=True)
    (folder / "yolo" / "data.yaml").write_text("nc: 2\nnames:\n  0: chair\n  1: table\n")
    points = [[30, 30], [90, 30], [90, 80]]
    for stem, view in zip(stems, scene.views, strict=False):
        (folder / "yolo" / "labels" / f"{stem}.txt").write_text("0 .5 .5 .2 .2 .9\n1 .1 .1 .3 .1 .3 .4\n")
        shapes = [{"label": "chair", "points": points, "shape_type": "polygon", "group_id": None}]
        document = {"shapes": shapes, "imagePath": view.name, "imageWidth": 320, "imageHeight": 240}
        (folder / "labelme" / f"{stem}.json").write_text(json.dumps(document))
        np.savez(folder / "npz" / f"{stem}.npz", masks=np.ones((2, 24, 32), dtype=bool), scores=[0.9, 0.8])
    (folder / "npz" / "labels.json").write_text(json.dumps({stem: ["chair", "table"] for stem in stems}))
    entry = {"id": "a", "category": "car", "dimensions": {"length": 4.0, "height": 1.5}, "truncated": ["length"]}
    free = {"category": "cup", "extents": [0.1, 0.08], "sigma": {"extent1": 0.1}, "score": 0.5}
    (folder / "objects" / "objects.json").write_text(json.dumps({"schema": SCHEMA, "objects": [entry, free]}))
    (folder / "objects" / "lengths.txt").write_text("0 0 0 1 0 0 0.5\n0 0 0 0 2 0 1.0 0.01 # a desk\n")
    truth = {"metres_per_unit": 0.3, "objects": [{"track_id": 1, "truth_m": {"height": {"value": 0.7}, "edge": 0.2}}]}
    (folder / "objects" / "truth.json").write_text(json.dumps(truth))
    write_video_seeds(folder, scene)
    write_web_seeds(folder)
