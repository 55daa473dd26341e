"""Compute a model from verified matches, in the worker process: map, register the remaining frames, choose a lens.

`mapping` writes every model that is better than the one before to a new folder 0, 1, ... of its output, so that the
last one is the best even if the process is ended.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from capture.mapping.camera_models import chosen_model, model_scores
from capture.mapping.model_metrics import aligned_distance, model_metrics, residual_pattern, residuals_of
from capture.mapping.refusals import MAX_CONTRADICTED_RATIO, MIN_COMPARED_PATTERN, MIN_WHOLE_RATIO
from capture.mapping.triplets import TripletAgreement, agreement, model_triplets
from estimator.reconstructions.colmap import read_colmap
from estimator.reconstructions.pycolmap_library import pycolmap

Model = Any  #: A `pycolmap.Reconstruction`.
Request = dict[str, Any]

#: Threads of a mapper. With more than one, the order of summation in the adjustment varies, which changes a focal
#: length by up to 1 %.
N_MAPPING_THREADS = 1
#: Minimum number of inliers of a frame that is placed; COLMAP's default is 30. With 15, 80 instead of 47 of 96 frames
#: of `courthouse_walk` are placed, 118 instead of 78 of `snow_walk`, 15 instead of 14 of `banana_lowtex`.
MIN_POSE_INLIERS = 15
#: Minimum ratio of shared frames at which the paths of two mappers are compared.
MIN_SHARED_RATIO = 0.5
#: Maximum relative change of the focal length by the camera model OPENCV, which is a pinhole with distortion as the
#: first one is. On `lund_street` it became 0.95 for 0.75 of the side, with a better held-out residual.
MAX_FOCAL_CHANGE = 0.05
#: Maximum number of frames with which a remaining frame is matched again.
MAX_PARTNERS = 6
#: Maximum ratio of descriptor distances of guided matches; along an epipolar line there are few candidates.
GUIDED_RATIO = 0.85


def mapping(request: Request, say: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Write the models of a database of verified matches, and return the figures of the last one.

    The request names the `database`, the folder of the `images`, an empty `output` folder, and the `cameras` to try in
    turn until most frames are placed and agree with the matches. Each has `model`, `params` (None: those of the
    database), `held` (until all frames are placed), `fixed` (the focal length is not refined) and `if_stated` (whether
    it is tried only if EXIF states the focal length, or only if not; None: in any case).
    """
    database, output = Path(request["database"]), Path(request["output"])
    with pycolmap.Database.open(database) as opened:
        n_frames = opened.num_images()
        is_stated = any(camera.has_prior_focal_length for camera in opened.read_all_cameras())
    n_best, n_written = -1, 0
    best: tuple[Model, dict[str, Any], Path] | None = None
    for number, camera in enumerate(request["cameras"]):
        if n_best >= MIN_WHOLE_RATIO * n_frames or camera["if_stated"] not in (None, is_stated):
            continue
        matches = database.with_name(f"{database.stem}.{number}.db")
        shutil.copyfile(database, matches)
        if camera["params"] is not None:
            verify_with_camera(matches, camera)
        model = map_frames(matches, request, camera, n_frames, say)
        n = -1 if model is None else n_consistent(model, matches)
        if model is not None and n > n_best:
            n_best, n_written, best = n, write_model(model, matches, output), (model, camera, matches)
    if best is None:
        return {"model": None}
    model, camera, matches = best
    if 2 < model.num_reg_images() < n_frames:
        guided = matches.with_suffix(".guided.db")
        more = register_remaining(model, matches, guided, request, camera, output / str(n_written - 1))
        if more is not None:
            n_written, model, matches = write_model(more, guided, output), more, guided
    agreed = cut_loose_frames(model, matches, camera["fixed"])
    if agreed.loose:
        n_written = write_model(model, matches, output)
        model = pycolmap.Reconstruction(output / str(n_written - 1))
    is_free = request["free"] and not camera["fixed"] and len(model.cameras) == 1
    lenses = choose_camera_model(model, output / str(n_written - 1)) if is_free else None
    if lenses is not None and lenses["chosen"] != lenses["before"]:
        write_model(model, matches, output)
    result = measure(request | {"fixed": camera["fixed"]})
    result["model"]["pieces"] = [len(part) for part in agreed.parts]  # before the cut
    return result | {"lenses": lenses}


def write_model(model: Model, matches: Path, output: Path) -> int:
    """Write a model, and the name of its database, to the next folder of the output; return the number of folders."""
    n = len(list(output.iterdir()))
    folder = output / str(n)
    folder.mkdir()
    model.write_binary(str(folder))
    (folder / "matches.txt").write_text(str(matches), encoding="utf-8")
    return n + 1


def choose_camera_model(model: Model, folder: Path) -> dict[str, Any] | None:
    """Adjust a model, which is in a folder, with the camera model that explains held-out observations best.

    Returns the scores of the camera models, the one before and the one that is chosen; None if the residuals have no
    pattern.
    """
    if residual_pattern(*residuals_of(read_colmap(folder))) <= MIN_COMPARED_PATTERN:
        return None
    (camera,) = model.cameras.values()
    before, scores = camera.model.name, model_scores(str(folder))
    likely = {
        name: score
        for name, score in scores.items()
        if name != "OPENCV" or abs(score["params"][0] / camera.params[0] - 1) < MAX_FOCAL_CHANGE
    }
    chosen = chosen_model(likely)
    if chosen != before:
        camera.model = getattr(pycolmap.CameraModelId, chosen)
        camera.params = scores[chosen]["params"]
        pycolmap.bundle_adjustment(model, pycolmap.BundleAdjustmentOptions(print_summary=False))
    return {"scores": scores, "before": before, "chosen": chosen}


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
        matches, request["images"], output, options=mapping_options(camera), next_image_callback=count
    )
    if not models:
        return None
    model = max(models.values(), key=lambda one: one.num_reg_images())
    if camera["held"]:
        options = pycolmap.BundleAdjustmentOptions(print_summary=False, refine_focal_length=not camera["fixed"])
        pycolmap.bundle_adjustment(model, options)
    return model


def mapping_options(camera: dict[str, Any]) -> Any:
    """Return COLMAP's default options, but for the minimum number of inliers, threads and seed."""
    refined = not camera["fixed"] and not camera["held"]
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=N_MAPPING_THREADS, random_seed=0, extract_colors=False, ba_refine_focal_length=refined
    )
    options.ba_refine_extra_params = not camera["held"]
    options.mapper.abs_pose_min_num_inliers = MIN_POSE_INLIERS
    options.mapper.abs_pose_refine_focal_length = refined
    options.mapper.abs_pose_refine_extra_params = not camera["held"]
    return options


def verify_with_camera(matches: Path, camera: dict[str, Any]) -> None:
    """Give the one camera of a database other parameters, and verify all matches through it.

    COLMAP verifies a pair by an essential matrix, on rays instead of pixels, if its camera has a prior focal length.
    Pairs of fisheye images fit no fundamental matrix.
    """
    with pycolmap.Database.open(matches) as database:
        (own,) = database.read_all_cameras()
        own.model, own.params = getattr(pycolmap.CameraModelId, camera["model"]), camera["params"]
        own.has_prior_focal_length = camera["held"]
        database.update_camera(own)
        pairs = [pycolmap.pair_id_to_image_pair(pair) for pair in database.read_num_matches()[0]]
        database.clear_two_view_geometries()
    with write_pairs(matches, pairs) as listed:
        pycolmap.verify_matches(matches, listed, verification_options())


def verification_options() -> Any:
    """Return COLMAP's default options with a fixed seed."""
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = 0
    return options


def register_remaining(
    model: Model, matches: Path, guided: Path, request: Request, camera: dict[str, Any], folder: Path
) -> Model | None:
    """Match the remaining frames again, along the epipolar lines of their first matches, and continue the mapping.

    Each remaining frame is matched with the frames before and after it and with those that it has most matches with.
    Returns the model if its largest consistent part has more frames than before.
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
    with write_pairs(guided, sorted(pairs)) as listed:
        pairing = pycolmap.ImportedPairingOptions(match_list_path=listed)
        pycolmap.match_image_pairs(
            guided, matching_options=options, pairing_options=pairing, verification_options=verification_options()
        )
    output = guided.with_suffix(".models")
    output.mkdir()
    continued = mapping_options(camera)
    continued.multiple_models = False
    models = pycolmap.incremental_mapping(guided, request["images"], output, options=continued, input_path=folder)
    more = max(models.values(), key=lambda one: one.num_reg_images(), default=None)
    if more is None or n_consistent(more, guided) <= n_consistent(model, matches):
        return None
    return more


def n_consistent(model: Model, matches: Path) -> int:
    """Return the number of frames in the largest part of a model that triplets of matches hold together.

    It is 0 if the model contradicts too many triplets.
    """
    agreed = agreement(model_triplets(model, str(matches)), model.num_reg_images())
    if not agreed.parts or agreed.contradicted > MAX_CONTRADICTED_RATIO * agreed.triplets:
        return 0
    return len(agreed.parts[0])


def measure(request: Request) -> dict[str, Any]:
    """Cut the last model of the output to its largest consistent part, colour its points, and return its figures.

    Frames that share less than two frames with the rest by triplets of matches have no scale relative to it.
    """
    folders = sorted(Path(request["output"]).iterdir(), key=lambda folder: int(folder.name))
    if not folders:
        return {"model": None}
    folder = folders[-1]
    model = pycolmap.Reconstruction(folder)
    matches = Path((folder / "matches.txt").read_text(encoding="utf-8"))
    agreed = cut_loose_frames(model, matches, request["fixed"])
    model.extract_colors_for_all_images(request["images"])
    model.write_binary(str(folder))
    model = pycolmap.Reconstruction(folder)  # the covariance also looks at deregistered frames, which have no pose
    figures = model_metrics(folder, focal_std(model), agreed)
    return {
        "model": msgspec.to_builtins(figures),
        "folder": str(folder),
        "matches": str(matches),
        "focal_held": request["fixed"],
        "lenses": None,
    }


def cut_loose_frames(model: Model, matches: Path, fixed: bool) -> TripletAgreement:
    """Cut a model to its largest consistent part and adjust it; return its agreement with the matches before.

    The figures of the triplets, except for the parts and the loose frames, are those of the part.
    """
    agreed = agreement(model_triplets(model, str(matches)), model.num_reg_images())
    if not agreed.loose:
        return agreed
    for image in [image for image in model.images.values() if image.has_pose and image.name in agreed.loose]:
        model.deregister_frame(image.frame_id)
    options = pycolmap.BundleAdjustmentOptions(print_summary=False, refine_focal_length=not fixed)
    pycolmap.bundle_adjustment(model, options)
    rest = agreement(model_triplets(model, str(matches)), model.num_reg_images())
    return replace(rest, parts=agreed.parts, loose=agreed.loose)


def compare_global(request: Request) -> dict[str, Any]:
    """Return the distance of a model's camera path from that of COLMAP's global mapper, relative to its extent.

    The request names the `database`, `images`, an empty `output` folder and the `folder` of the model.
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
    centres = np.array([[own[name], their[name]] for name in shared])
    return {"disagreement": aligned_distance(centres[:, 1], centres[:, 0])}


def focal_std(model: Model) -> float | None:
    """Return the standard deviation of the focal length, relative to it, if every observation had an error of 1 px.

    It is the square root of the focal length's entry in (J^T J)^-1, with the Jacobian J of all reprojection errors by
    poses, points and camera parameters; the median of several cameras; None if the matrix cannot be inverted. A camera
    that moves without turning does not determine its focal length (Sturm 1999, "Critical motion sequences for the
    self-calibration of cameras"): the residuals of such a model are small, and only this figure shows it.
    """
    options = pycolmap.BundleAdjustmentOptions(refine_focal_length=True, refine_extra_params=True)
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    covariance = pycolmap.estimate_ba_covariance(pycolmap.BACovarianceOptions(), model, adjuster)
    if covariance is None:
        return None
    deviations = []
    for camera in model.cameras.values():
        of_camera = covariance.get_other_params_cov(camera.params)  # (p, p), the focal length first
        if of_camera is not None and of_camera[0, 0] >= 0:
            deviations.append(float(np.sqrt(of_camera[0, 0]) / camera.params[0]))
    return float(np.median(deviations)) if deviations and np.isfinite(deviations).all() else None


@contextmanager
def write_pairs(database: Path, pairs: Sequence[tuple[int, int]]) -> Iterator[Path]:
    """Write a file of pairs of image ids for COLMAP, which reads two names with a space between.

    Names of images may contain spaces, so that meanwhile the images are named by their ids.
    """
    listed = database.with_suffix(".pairs.txt")
    with pycolmap.Database.open(database) as opened:
        names = {image.image_id: image.name for image in opened.read_all_images()}
    rename_images(database, {image_id: str(image_id) for image_id in names})
    listed.write_text("".join(f"{first} {second}\n" for first, second in pairs), encoding="utf-8")
    try:
        yield listed
    finally:
        rename_images(database, names)
        listed.unlink(missing_ok=True)


def rename_images(database: Path, names: dict[int, str]) -> None:
    """Give the images of a database, by their ids, other names."""
    with pycolmap.Database.open(database) as opened:
        for image_id, name in names.items():
            image = opened.read_image(image_id)
            image.name = name
            opened.update_image(image)
