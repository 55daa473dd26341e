"""Reconstruct a synthetic world from rendered frames with pycolmap: SIFT, matching, incremental mapping."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np

from tests.synthetic.rooms.masks import coco_dataset
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.similarity import random_similarity, similarity_between
from tests.synthetic.rooms.truth import Truth, truth_of
from tests.synthetic.rooms.world import World

__all__ = ["NotReconstructed", "reconstruct"]

#: Maximum number of features per frame, of about 6,000. COLMAP keeps the coarsest, so that small objects lose points
#: first; all features would take three times as long.
FEATURES = 2500
#: Number of following frames that each frame is matched with, in addition to frames at powers of two (COLMAP's video
#: matching).
OVERLAP = 5
#: Standard deviation of the sensor noise in grey levels, as for a phone indoors.
SENSOR_NOISE = 2.5
#: JPEG quality of the frames, similar to the video of a phone.
QUALITY = 92
#: Minimum fraction of registered frames of a reconstruction.
MIN_REGISTERED_FRACTION = 0.5


class NotReconstructed(RuntimeError):
    """Structure from motion registered too few frames; the message states their number."""


def reconstruct(
    world: World, folder: Path, seed: int = 0, texture: float = 1.0, features: int = FEATURES, quality: int = QUALITY
) -> Truth:
    """Write frames, `sparse/0`, `instances.json` and `truth.json` to `folder`, and return the truth.

    The model is transformed by a random similarity, which images cannot determine. Its true scale is the scale of the
    similarity between its camera centres and the true ones.

    Raises
    ------
    NotReconstructed
        Structure from motion registers fewer than half of the frames.
    NoOpenGL
        The frames cannot be rendered.
    """
    images = folder / "images"
    images.mkdir(parents=True, exist_ok=True)
    names = _write_frames(world, images, folder, texture, quality)
    model = _model(images, folder / "work", world, features)
    truth = _truth(world, model, names, seed)
    target = folder / "sparse" / "0"
    target.mkdir(parents=True, exist_ok=True)
    model.write_binary(str(target))
    shutil.rmtree(folder / "work")
    (folder / "truth.json").write_text(json.dumps(truth.json(), indent=1) + "\n")
    return truth


def _write_frames(world: World, images: Path, folder: Path, texture: float, quality: int) -> list[str]:
    import cv2

    names, ids = [], []
    generator = np.random.default_rng([world.seed, 11])
    with Renderer(world, texture) as renderer:
        for index in range(len(world.poses)):
            frame = renderer.frame(index)
            assert frame.colour is not None
            names.append(f"frame{index:03d}.jpg")
            noisy = frame.colour[..., ::-1] + generator.normal(0, SENSOR_NOISE, frame.colour.shape)
            cv2.imwrite(
                str(images / names[-1]), np.clip(noisy, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality]
            )
            ids.append(frame.ids)
    (folder / "instances.json").write_text(json.dumps(coco_dataset(world, ids, names)) + "\n")
    return names


def _model(images: Path, work: Path, world: World, features: int):  # type: ignore[no-untyped-def]
    """Return the largest model of pycolmap. The focal length is given, as by the EXIF of a phone, and refined."""
    import pycolmap

    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    pycolmap.logging.minloglevel = 3
    database = work / "database.db"
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.sift.max_num_features = features
    extraction.num_threads = 2
    reader = pycolmap.ImageReaderOptions(
        camera_model="SIMPLE_RADIAL", default_focal_length_factor=world.camera.focal / world.camera.width
    )
    pycolmap.extract_features(
        database, images, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader, extraction_options=extraction
    )
    matching = pycolmap.FeatureMatchingOptions(num_threads=2)
    pairing = pycolmap.SequentialPairingOptions(overlap=OVERLAP, quadratic_overlap=True)
    pycolmap.match_sequential(database, matching_options=matching, pairing_options=pairing)
    options = pycolmap.IncrementalPipelineOptions(num_threads=2, random_seed=0, extract_colors=False, min_model_size=3)
    options.mapper.init_min_tri_angle = 8.0  # the steps are small; COLMAP's 16 degrees are for photographs
    if world.kind == "street":  # only forward motion, which COLMAP avoids for the initial pair by default
        options.mapper.init_max_forward_motion, options.mapper.init_min_tri_angle = 1.0, 4.0
    models = pycolmap.incremental_mapping(database, images, work, options=options)
    best = max(models.values(), key=lambda model: model.num_reg_images(), default=None)
    registered = 0 if best is None else best.num_reg_images()
    if best is None or registered < MIN_REGISTERED_FRACTION * len(world.poses):
        message = f"{images}: pycolmap registered {registered} of {len(world.poses)} frames"
        raise NotReconstructed(message)
    return best


def _truth(world: World, model, names: list[str], seed: int) -> Truth:  # type: ignore[no-untyped-def]
    """Apply a random similarity to the model, and align its cameras with the true ones."""
    import pycolmap

    change = random_similarity(np.random.default_rng([seed, 7]))
    model.transform(pycolmap.Sim3d(change.scale, pycolmap.Rotation3d(change.rotation), change.translation))
    views = [image for image in model.images.values() if image.has_pose]
    centres = np.array([image.projection_center() for image in views])
    true = np.array([world.poses[names.index(image.name)].centre for image in views])
    to_scene = similarity_between(true, centres)
    rms = float(np.sqrt(((to_scene.inverse(centres) - true) ** 2).sum(axis=1).mean()))
    return truth_of(world, to_scene, rms)
