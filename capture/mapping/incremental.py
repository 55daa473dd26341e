"""Compute a model from verified matches, in the worker process: map, register the remaining frames, choose a lens.

`mapping` writes every model that is better than the one before to a new folder 0, 1, ... of its output, with its
database next to it as 0.db, 1.db, ..., so that `finish` has the best model so far even if the mapping was ended.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from capture.mapping.camera_models import (
    CANDIDATE_MODELS,
    CameraModelChoice,
    chosen_model,
    focal_change,
    model_scores,
)
from capture.mapping.covariance import standard_deviations
from capture.mapping.model_metrics import lens_bend, model_metrics, residual_pattern, residuals_of
from capture.mapping.refusals import (
    MAX_BEND,
    MAX_CONTRADICTED_RATIO,
    MAX_STEP_STD,
    MIN_COMPARED_PATTERN,
    MIN_WARNED_FOCAL_VARIATION,
    MIN_WHOLE_RATIO,
)
from capture.mapping.triplets import agreement, model_triplets
from estimator.evidence.alignment import least_squares
from estimator.projection.cameras import make_camera
from estimator.reconstructions.colmap import read_colmap
from estimator.reconstructions.pycolmap_library import pycolmap

Model = Any  #: A `pycolmap.Reconstruction`.
Request = dict[str, Any]

#: Threads of a mapper. With more than one, the order of summation in the adjustment varies, which changes a focal
#: length by up to 1 %.
N_MAPPING_THREADS = 1
#: Minimum number of inliers to place a frame; COLMAP's default is 30. With 15, 80 instead of 47 of 96 frames
#: of `courthouse_walk` are placed, 118 instead of 78 of `snow_walk`, 15 instead of 14 of `banana_lowtex`.
MIN_POSE_INLIERS = 15
#: Minimum fraction of the frames that two models must share for a comparison of their paths.
MIN_SHARED_RATIO = 0.5
#: Maximum number of frames with which a remaining frame is matched again.
MAX_PARTNERS = 6
#: Maximum ratio of descriptor distances of guided matches; along an epipolar line there are few candidates.
GUIDED_RATIO = 0.85


def mapping(request: Request, say: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Map the frames of a database of verified matches, and return the figures of the best model.

    The request names the `database`, the folder of the `images`, an empty `output` folder, whether the focal length is
    `fixed` and the camera model `free`, the number of frames that are `linked` by pairs, and the `cameras` to try in
    turn until most of the linked frames are placed and agree with the matches. Each camera has `model`, `params` (None:
    from the database), `held` (the camera is not refined until all frames are placed), and `if_stated` (whether it is
    tried only if EXIF states the focal length, or only if not; None: in any case).
    """
    database, output = Path(request["database"]), Path(request["output"])
    with pycolmap.Database.open(database) as opened:
        n_frames = opened.num_images()
        is_stated = any(camera.has_prior_focal_length for camera in opened.read_all_cameras())
    n_best = -1
    best: tuple[Model, dict[str, Any], Path] | None = None
    for number, camera in enumerate(request["cameras"]):
        if n_best >= MIN_WHOLE_RATIO * request["linked"] or camera["if_stated"] not in (None, is_stated):
            continue
        matches = output / f"{number}.db"
        shutil.copyfile(database, matches)
        if camera["params"] is not None:
            verify_with_camera(matches, camera)
        model = map_frames(matches, request, camera, n_frames, say)
        n = -1 if model is None else n_consistent(model, matches)
        if model is not None and n > n_best:
            n_best, best = n, (model, camera, matches)
            write_model(model, output / str(number))
    if best is not None and 2 < n_best < n_frames:
        model, camera, matches = best
        agreed = agreement(model_triplets(model, str(matches)))
        if not agreed.is_split:
            guided = output / f"{len(request['cameras'])}.db"
            (output / "consistent").mkdir()
            model = without_frames(model, agreed.loose, output / "consistent", request["fixed"])
            more = register_remaining(model, output / "consistent", matches, guided, request, camera)
            if more is not None:
                write_model(more, guided.with_suffix(""))
    return finish(request)


def write_model(model: Model, folder: Path) -> None:
    """Write a model to a new folder, which appears when it is complete."""
    part = folder.with_suffix(".part")
    part.mkdir()
    model.write_binary(str(part))
    part.rename(folder)


def finish(request: Request) -> dict[str, Any]:
    """Remove the frames of the last model that the matches do not support, choose its lens, and return its figures.

    Frames outside the largest consistent part share fewer than two frames with it by triplets of matches, and have no
    scale relative to it. Frames whose steps are undetermined are constrained by distant points only. The result has the
    figures in `model`, its `folder`, its database `matches`, and the compared `lenses`.
    """
    output = Path(request["output"])
    written = sorted((folder for folder in output.iterdir() if folder.name.isdecimal()), key=lambda one: int(one.name))
    if not written:
        return {"model": None}
    matches, folder = written[-1].with_suffix(".db"), output / "final"
    model = pycolmap.Reconstruction(written[-1])
    agreed = agreement(model_triplets(model, str(matches)))
    folder.mkdir(exist_ok=True)
    model = without_frames(model, agreed.loose, folder, request["fixed"])
    undetermined: list[str] = []
    while more := [name for name, std in standard_deviations(model)[1].items() if std > MAX_STEP_STD]:
        undetermined += more
        model = without_frames(model, more, folder, request["fixed"])
    is_compared = not request["fixed"] and len(model.cameras) == 1
    lenses = compare_camera_models(model, folder, request["free"]) if is_compared else None
    model.extract_colors_for_all_images(request["images"])
    model.write_binary(str(folder))
    focal_std, steps = standard_deviations(model)
    figures = model_metrics(folder, focal_std, agreed)
    may_zoom = len(model.cameras) == 1 and (figures.focal_spread or 0.0) > MIN_WARNED_FOCAL_VARIATION
    change, change_error = focal_change(folder) if may_zoom else (0.0, 0.0)
    figures = msgspec.structs.replace(
        figures,
        focal_change=change,
        focal_change_error=change_error,
        step_deviation=max(steps.values(), default=None),
        undetermined=tuple(sorted(undetermined)),
    )
    return {
        "model": msgspec.to_builtins(figures),
        "folder": str(folder),
        "matches": str(matches),
        "lenses": msgspec.to_builtins(lenses),
    }


def without_frames(model: Model, names: Iterable[str], folder: Path, fixed: bool) -> Model:
    """Return a model without some of its frames, adjusted again if there are any; the folder receives it."""
    names = set(names)
    for image in [image for image in model.images.values() if image.has_pose and image.name in names]:
        model.deregister_frame(image.frame_id)
    if names:
        adjust(model, fixed)
    model.write_binary(str(folder))
    # reload, because the covariance would include deregistered frames, which have no pose
    return pycolmap.Reconstruction(folder)


def adjust(model: Model, fixed: bool = False) -> None:
    """Adjust all frames and points of a model, and filter its points as COLMAP's mapper does after an adjustment."""
    options = pycolmap.BundleAdjustmentOptions(print_summary=False, refine_focal_length=not fixed)
    pycolmap.bundle_adjustment(model, options)
    limits = pycolmap.IncrementalMapperOptions()
    pycolmap.ObservationManager(model).filter_all_points3D(limits.filter_max_reproj_error, limits.filter_min_tri_angle)


def compare_camera_models(model: Model, folder: Path, is_free: bool) -> CameraModelChoice | None:
    """Compare camera models by held-out observations of a model, of which `folder` has a copy.

    If the camera model is free, the model is adjusted with the one that explains them best; otherwise the user's is
    kept. Returns None if the residuals have no pattern.
    """
    if residual_pattern(*residuals_of(read_colmap(folder))) <= MIN_COMPARED_PATTERN:
        return None
    (camera,) = model.cameras.values()
    before = camera.model.name
    names = CANDIDATE_MODELS if is_free else tuple(dict.fromkeys([before, *CANDIDATE_MODELS]))
    scores = model_scores(folder, names)
    chosen = chosen_model(scores)
    if is_free and chosen != before:
        camera.model = getattr(pycolmap.CameraModelId, chosen)
        camera.params = scores[chosen].params
        adjust(model)
    return CameraModelChoice(scores, before, chosen)


def map_frames(
    matches: Path, request: Request, camera: dict[str, Any], n_frames: int, say: Callable[[dict[str, Any]], None]
) -> Model | None:
    """Return the largest model of COLMAP's incremental mapper, None if it finds none."""
    placed = [2]

    def count() -> None:
        placed[0] = min(placed[0] + 1, n_frames)
        say({"done": placed[0], "of": n_frames})

    output = matches.with_suffix(".models")
    output.mkdir()
    models = pycolmap.incremental_mapping(
        matches, request["images"], output, options=mapping_options(request, camera), next_image_callback=count
    )
    if not models:
        return None
    model = max(models.values(), key=lambda one: one.num_reg_images())
    if camera["held"]:
        adjust(model, request["fixed"])
    return model


def mapping_options(request: Request, camera: dict[str, Any]) -> Any:
    """Return COLMAP's default options, except for the minimum number of inliers, threads and seed."""
    refined = not request["fixed"] and not camera["held"]
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=N_MAPPING_THREADS, random_seed=0, extract_colors=False, ba_refine_focal_length=refined
    )
    options.ba_refine_extra_params = not camera["held"]
    options.mapper.abs_pose_min_num_inliers = MIN_POSE_INLIERS
    options.mapper.abs_pose_refine_focal_length = refined
    options.mapper.abs_pose_refine_extra_params = not camera["held"]
    return options


def verify_with_camera(matches: Path, camera: dict[str, Any]) -> None:
    """Replace the parameters of the only camera of a database, and verify all matches through it.

    COLMAP verifies a pair by an essential matrix, on rays instead of pixels, if its camera has a prior focal length.
    Pairs of fisheye images fit no fundamental matrix.
    """
    with pycolmap.Database.open(matches) as database:
        (own,) = database.read_all_cameras()
        own.model, own.params = getattr(pycolmap.CameraModelId, camera["model"]), camera["params"]
        own.has_prior_focal_length = camera["held"]
        database.update_camera(own)
        database.clear_two_view_geometries()
    pycolmap.geometric_verification(matches, two_view_geometry_options=verification_options())


def verification_options() -> Any:
    """Return COLMAP's default options with a fixed seed."""
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = 0
    return options


def register_remaining(
    model: Model, folder: Path, matches: Path, guided: Path, request: Request, camera: dict[str, Any]
) -> Model | None:
    """Match the remaining frames again, along the epipolar lines of their first matches, and continue the mapping.

    Each remaining frame is matched with the frames before and after it and with those with which it has the most
    matches. The model, whose frames are consistent, is also in a folder; `guided` is the new database. Returns the
    model if its largest consistent part has more frames than before.
    """
    shutil.copyfile(matches, guided)
    placed = {image.image_id for image in model.images.values() if image.has_pose}
    with pycolmap.Database.open(guided) as database:
        order = [image.image_id for image in sorted(database.read_all_images(), key=lambda image: image.name)]
        counts: dict[int, dict[int, int]] = {image_id: {} for image_id in order}
        for pair, count in zip(*database.read_num_matches(), strict=True):
            first, second = pycolmap.pair_id_to_image_pair(pair)
            counts[first][second] = counts[second][first] = int(count)
        pairs = set()
        for place, image_id in enumerate(order):
            if image_id not in placed:
                near = [order[k] for k in (place - 1, place + 1) if 0 <= k < len(order)]
                most = sorted(counts[image_id], key=lambda other: -counts[image_id][other])[: MAX_PARTNERS - len(near)]
                pairs |= {(min(image_id, other), max(image_id, other)) for other in (*near, *most)}
        for first, second in pairs:
            if database.exists_matches(first, second):
                database.delete_matches(first, second)
            if database.exists_two_view_geometry(first, second):
                database.delete_two_view_geometry(first, second)
    options = pycolmap.FeatureMatchingOptions(guided_matching=True)
    options.sift.max_ratio = GUIDED_RATIO
    match_pairs(guided, sorted(pairs), options)
    output = guided.with_suffix(".models")
    output.mkdir()
    continued = mapping_options(request, camera)
    continued.multiple_models = False
    models = pycolmap.incremental_mapping(guided, request["images"], output, options=continued, input_path=folder)
    more = max(models.values(), key=lambda one: one.num_reg_images(), default=None)
    return more if more is not None and n_consistent(more, guided) > model.num_reg_images() else None


def n_consistent(model: Model, matches: Path) -> int:
    """Return the number of frames in the largest part of a model that triplets of matches hold together.

    It is 0 if the model contradicts too many triplets, or if its camera has a distortion that no lens has: the focal
    length of a wide lens may end in a local minimum that the distortion compensates, and another start is needed.
    """
    for camera in model.cameras.values():
        bend = lens_bend(make_camera(camera.model.name, (camera.width, camera.height), camera.params))
        if bend > MAX_BEND and "FISHEYE" not in camera.model.name:
            return 0
    agreed = agreement(model_triplets(model, str(matches)))
    if not agreed.parts or agreed.contradicted > MAX_CONTRADICTED_RATIO * agreed.triplets:
        return 0
    return len(agreed.parts[0])


def compare_global(request: Request) -> dict[str, Any]:
    """Return the distance of a model's camera path from that of COLMAP's global mapper, relative to its extent.

    It is the root mean square distance of the camera centres after the best similarity. The request names the
    `database`, `images`, an empty `output` folder and the `folder` of the model.
    """
    options = pycolmap.GlobalPipelineOptions(num_threads=N_MAPPING_THREADS, random_seed=0)
    models = pycolmap.global_mapping(request["database"], request["images"], request["output"], options=options)
    other = max(models.values(), key=lambda one: one.num_reg_images(), default=None)
    if other is None:
        return {"disagreement": None}
    own, their = (
        {image.name: image.projection_center() for image in model.images.values() if image.has_pose}
        for model in (pycolmap.Reconstruction(request["folder"]), other)
    )
    shared = sorted(own.keys() & their.keys())
    if len(shared) < MIN_SHARED_RATIO * len(own):
        return {"disagreement": None}
    fit = least_squares(
        np.array([their[name] for name in shared]),
        np.array([own[name] for name in shared]),
        np.ones(len(shared), dtype=bool),
    )
    return {"disagreement": None if fit is None else math.sqrt(3) * fit.residual / fit.extent}


def match_pairs(database: Path, pairs: Sequence[tuple[int, int]], options: Any) -> None:
    """Match and verify pairs of image ids with `pycolmap.FeatureMatchingOptions`.

    COLMAP reads a file of pairs of names with a space between. Names of images may contain spaces, so that meanwhile
    the images are named by their ids.
    """
    listed = database.with_suffix(".pairs.txt")
    with pycolmap.Database.open(database) as opened:
        names = {image.image_id: image.name for image in opened.read_all_images()}
    rename_images(database, {image_id: str(image_id) for image_id in names})
    listed.write_text("".join(f"{first} {second}\n" for first, second in pairs), encoding="utf-8")
    pairing = pycolmap.ImportedPairingOptions(match_list_path=listed)
    try:
        pycolmap.match_image_pairs(
            database, matching_options=options, pairing_options=pairing, verification_options=verification_options()
        )
    finally:
        rename_images(database, names)
        listed.unlink(missing_ok=True)


def rename_images(database: Path, names: dict[int, str]) -> None:
    """Rename the images of a database; `names` are by id."""
    with pycolmap.Database.open(database) as opened:
        for image_id, name in names.items():
            image = opened.read_image(image_id)
            image.name = name
            opened.update_image(image)
