"""The readers on a real office: binary, text and OpenSfM files agree with each other, pycolmap and the README."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from pycocotools import mask as coco

from estimator.instances.instance_reader import read_instances, read_instances_and_warnings
from estimator.outputs.rescaled import write_rescaled
from estimator.projection.cameras import pixels_in_view
from estimator.reconstructions.scene_reader import read_scene

pytestmark = pytest.mark.real_data

#: Numbers of views, points, observations, dense points, masks and boxes in the README of the scene.
VIEWS, POINTS, OBSERVATIONS, DENSE, MASKS, BOXES = 17, 4959, 19794, 293232, 326, 102


@pytest.fixture(scope="module")
def office(shared: Path) -> Path:
    return shared / "data" / "scenes" / "tum_office"


def test_counts_agree_with_the_readme(office: Path) -> None:
    scene = read_scene(office)
    assert len(scene.views) == VIEWS
    assert len(scene.points) == POINTS
    assert sum(len(view.keypoints) for view in scene.views) == OBSERVATIONS
    assert scene.dense is not None
    assert len(scene.dense.points) == DENSE
    assert scene.dense.visible_views is not None
    assert not scene.warnings


def test_binary_text_and_opensfm_models_are_equal(office: Path) -> None:
    binary = read_scene(office / "sparse" / "0")
    reconstruction = pycolmap.Reconstruction(str(office / "sparse" / "0"))
    for form in ("sparse", "sparse_txt", "opensfm"):
        scene = read_scene(office / form)
        by_name = {view.name: view for view in scene.views}
        for view in binary.views:
            other = by_name[view.name]
            pose = reconstruction.find_image_with_name(view.name).cam_from_world()
            np.testing.assert_allclose(other.rotation, pose.rotation.matrix(), atol=1e-9)
            np.testing.assert_allclose(other.translation, pose.translation, atol=1e-9)
            ours = np.column_stack([other.keypoints, scene.points[other.point_index]])
            theirs = np.column_stack([view.keypoints, binary.points[view.point_index]])
            # sorted by the coordinates of the points, which are equal except for the last digit
            ours, theirs = ours[np.lexsort(ours[:, 2:].T)], theirs[np.lexsort(theirs[:, 2:].T)]
            np.testing.assert_allclose(ours, theirs, atol=1e-4)


def test_mean_reprojection_error_agrees_with_the_readme(office: Path) -> None:
    scene = read_scene(office, "none")
    errors_px = []
    for view in scene.views:
        pixels, _ = pixels_in_view(view, scene.points[view.point_index])
        errors_px.append(np.linalg.norm(pixels - view.keypoints, axis=1))
    # COLMAP's value of 0.87 is the mean over points of the mean of each point; over observations it is 0.89
    assert np.nanmean(np.concatenate(errors_px)) == pytest.approx(0.89, abs=0.02)


@pytest.mark.parametrize("form", [".", "opensfm"])
def test_visible_dense_points_project_into_their_views(form: str, office: Path) -> None:
    """The shots of the OpenSfM file are in another order than the images of the visibility file."""
    scene = read_scene(office / form, office / "dense.ply")
    dense = scene.dense
    assert dense is not None
    assert dense.visible_views is not None
    assert dense.visible_offsets is not None
    points = np.repeat(np.arange(DENSE), np.diff(dense.visible_offsets))
    for row in (0, 8, 16):
        visible = dense.points[points[dense.visible_views == row]]
        assert np.isfinite(pixels_in_view(scene.views[row], visible)[0][:, 0]).mean() > 0.99


def test_masks_equal_the_masks_of_pycocotools(office: Path) -> None:
    scene = read_scene(office, "none")
    instances, warnings = read_instances_and_warnings(scene)
    document = json.loads((office / "instances.json").read_text(encoding="utf-8"))
    assert len(instances) == len(document["annotations"]) == MASKS
    assert not warnings
    names = {image["id"]: image["file_name"] for image in document["images"]}
    for instance, annotation in zip(instances, document["annotations"], strict=True):
        mask = np.zeros((480, 640), dtype=bool)
        (x, y), (height, width) = instance.origin, instance.mask.shape
        mask[y : y + height, x : x + width] = instance.mask
        np.testing.assert_array_equal(mask, np.asarray(coco.decode(annotation["segmentation"]), dtype=bool))
        assert scene.views[instance.view].name == names[annotation["image_id"]]
        assert instance.track == str(annotation["track_id"])
    assert len({instance.track for instance in instances}) == 32


def test_boxes_of_a_detector_have_the_names_of_their_categories(office: Path) -> None:
    instances = read_instances(office / "detections_yolo.json", read_scene(office, "none"))
    assert len(instances) == BOXES
    assert all(instance.from_box for instance in instances)
    assert {"chair", "person", "refrigerator"} <= {instance.category for instance in instances}


def test_camera_path_of_the_rescaled_office_has_its_true_length(office: Path, tmp_path: Path) -> None:
    truth = json.loads((office / "truth.json").read_text(encoding="utf-8"))
    scene = read_scene(office, "none")
    write_rescaled(scene, truth["metres_per_unit"], tmp_path / "metric")
    scaled = {view.name: view.centre for view in read_scene(tmp_path / "metric").views}
    centres = np.array([scaled[name] for name in sorted(scaled)])
    # the path is 4.61 m long by motion capture; both are sampled once per second
    length = np.linalg.norm(np.diff(centres, axis=0), axis=1).sum()
    assert length == pytest.approx(truth["path_length_m"], rel=0.02)
