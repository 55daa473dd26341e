"""A test world reconstructed end to end: rendered frames through pycolmap: SIFT, matching, incremental mapping."""

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

#: Features a frame of about 6,000 that there are. COLMAP keeps the coarsest, so that small objects lose points first;
#: all of them would cost three times the time.
FEATURES = 2500
#: Each frame is matched with this many next ones, and with those at powers of two, as COLMAP does for video.
OVERLAP = 5
#: One sigma of the sensor's noise in grey levels: a telephone indoors.
SENSOR_NOISE = 2.5
#: JPEG quality of the frames: a telephone's video is no better.
QUALITY = 92
#: Frames of the walk that must register for a scene to count as reconstructed.
REGISTERED_SHARE = 0.5


class NotReconstructed(RuntimeError):
    """The structure from motion failed, as it does in life; the message says how many frames it placed."""


def reconstruct(
    world: World, folder: Path, seed: int = 0, texture: float = 1.0, features: int = FEATURES, quality: int = QUALITY
) -> Truth:
    """Frames, `sparse/0`, `instances.json` and `truth.json` in `folder`, and the truth.

    Raises NotReconstructed where structure from motion places too few frames, NoOpenGL where nothing can be rendered.

    The model is as pycolmap leaves it but for a random similarity, which changes nothing that can be known from
    images. Its true scale comes from the similarity that carries its camera centres onto the true ones.
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
            assert frame.colour is not None  # asked for
            names.append(f"frame{index:03d}.jpg")
            noisy = frame.colour[..., ::-1] + generator.normal(0, SENSOR_NOISE, frame.colour.shape)
            cv2.imwrite(
                str(images / names[-1]), np.clip(noisy, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality]
            )
            ids.append(frame.ids)
    (folder / "instances.json").write_text(json.dumps(coco_dataset(world, ids, names)) + "\n")
    return names


def _model(images: Path, work: Path, world: World, features: int):  # type: ignore[no-untyped-def]
    """The largest model that pycolmap builds; the focal length is given as a telephone gives it, then refined."""
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
    options.mapper.init_min_tri_angle = 8.0  # the walk's steps are small; COLMAP's 16 degrees suit photographs
    if world.kind == "street":  # driving is all forward motion, which COLMAP would rather not start from
        options.mapper.init_max_forward_motion, options.mapper.init_min_tri_angle = 1.0, 4.0
    models = pycolmap.incremental_mapping(database, images, work, options=options)
    best = max(models.values(), key=lambda model: model.num_reg_images(), default=None)
    placed = 0 if best is None else best.num_reg_images()
    if best is None or placed < REGISTERED_SHARE * len(world.poses):
        message = f"{images}: pycolmap placed {placed} of {len(world.poses)} frames"
        raise NotReconstructed(message)
    return best


def _truth(world: World, model, names: list[str], seed: int) -> Truth:  # type: ignore[no-untyped-def]
    """Apply a random similarity to the model and align its cameras with the true ones."""
    import pycolmap

    change = random_similarity(np.random.default_rng([seed, 7]))
    model.transform(pycolmap.Sim3d(change.scale, pycolmap.Rotation3d(change.rotation), change.translation))
    views = [image for image in model.images.values() if image.has_pose]
    centres = np.array([image.projection_center() for image in views])
    true = np.array([world.poses[names.index(image.name)].centre for image in views])
    to_scene = similarity_between(true, centres)
    rms = float(np.sqrt(((to_scene.inverse(centres) - true) ** 2).sum(axis=1).mean()))
    return truth_of(world, to_scene, rms)
