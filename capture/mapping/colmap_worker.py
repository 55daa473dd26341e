"""Structure from motion in a process of its own, so that what aborts in C++ ends this process and no other.

`python -m capture.mapping.colmap_worker STEP REQUEST.json` prints lines of JSON: `{"done": 3, "of": 40}`
on the way and `{"result": ...}` at the end.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.mapping.camera_models import chosen_model, model_scores
from capture.mapping.pairs import all_pairs, chosen_pairs, coarse_scores
from capture.mapping.triplets import agreement, model_triplets
from estimator.reconstructions.pycolmap_library import pycolmap

Request = dict[str, Any]

#: Pictures, and pairs, handled between two lines of progress.
PICTURES_AT_ONCE = 8
PAIRS_AT_ONCE = 150
#: Linux's prctl(PR_SET_PDEATHSIG): this process ends with the one that started it, even if that was killed.
_PARENT_DEATH_SIGNAL = 1


def run_step(words: Sequence[str], steps: Mapping[str, Callable[[Request], dict[str, Any]]]) -> None:
    """Run the step that is named on its request.

    words : step, file of the request, id of the parent process, and the seconds of processor that it may use, if any.
    """
    step, file, parent, *seconds = words
    _end_with_parent(int(parent))
    for limit_s in seconds:
        _end_after(int(limit_s))
    request: Request = json.loads(Path(file).read_text(encoding="utf-8"))
    pycolmap.logging.minloglevel = 1
    result = steps[step](request)
    say({"result": result})


def features(request: Request) -> dict[str, Any]:
    """SIFT features of the named pictures into a new database; how many each has, by name."""
    done, n = 0, sum(len(camera["names"]) for camera in request["cameras"])
    for camera in request["cameras"]:
        camera_id = -1
        for start in range(0, len(camera["names"]), PICTURES_AT_ONCE):
            some = camera["names"][start : start + PICTURES_AT_ONCE]
            _extract(request, some, camera["params"], camera_id)
            done += len(some)
            say({"done": done, "of": n})
            with pycolmap.Database.open(request["database"]) as database:
                camera_id = max(known.camera_id for known in database.read_all_cameras())
    with pycolmap.Database.open(request["database"]) as database:
        counts = {image.name: database.num_keypoints_for_image(image.image_id) for image in database.read_all_images()}
    return {"keypoints": {name: int(count) for name, count in counts.items()}}


def _extract(request: Request, names: list[str], params: str, camera_id: int) -> None:
    """Features of pictures that share a camera: the one of this id, or a new one for -1."""
    extraction = pycolmap.FeatureExtractionOptions(num_threads=request["threads"], max_image_size=request["max_side"])
    for option, value in request["sift"].items():
        setattr(extraction.sift, option, value)
    reader = pycolmap.ImageReaderOptions(
        camera_model=request["camera_model"],
        default_focal_length_factor=request["focal_factor"],
        camera_params=params,
        existing_camera_id=camera_id,
    )
    pycolmap.extract_features(
        request["database"],
        request["pictures"],
        image_names=names,
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=extraction,
    )


def matches(request: Request) -> dict[str, Any]:
    """Match the pairs that may overlap and verify them; each verified pair with what its geometry says."""
    names: list[str] = request["names"]
    with pycolmap.Database.open(request["database"]) as database:
        ids = {image.name: image.image_id for image in database.read_all_images()}
        few = len(names) <= request["exhaustive"]
        described = [] if few else [_strongest(database, ids[name]) for name in names]
    pairs = all_pairs(len(names)) if few else chosen_pairs(coarse_scores(described), request["in_order"])
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = 0
    matching = pycolmap.FeatureMatchingOptions(num_threads=request["threads"], guided_matching=request["guided"])
    matching.sift.max_ratio = request["ratio"]
    say({"done": 0, "of": len(pairs)})
    with _pair_list(request["database"]) as listed:
        for start in range(0, len(pairs), PAIRS_AT_ONCE):
            some = pairs[start : start + PAIRS_AT_ONCE]
            listed.write_text("".join(f"{ids[names[a]]} {ids[names[b]]}\n" for a, b in some), encoding="utf-8")
            pycolmap.match_image_pairs(
                request["database"],
                matching_options=matching,
                pairing_options=pycolmap.ImportedPairingOptions(match_list_path=listed),
                verification_options=verification,
            )
            say({"done": min(start + PAIRS_AT_ONCE, len(pairs)), "of": len(pairs)})
    with pycolmap.Database.open(request["database"]) as database:
        rows = [_pair_row(database, ids[names[a]], ids[names[b]]) for a, b in pairs]
    return {"pairs": [[a, b, *row] for (a, b), row in zip(pairs, rows, strict=True)]}


def verification(request: Request) -> dict[str, Any]:
    """Give the one camera of the database another lens and verify all matches through it; how many are left.

    A pair whose camera has a focal length that COLMAP believes is verified by an essential matrix, on rays instead of
    pixels; it takes no pair of fisheye pictures otherwise.
    """
    lens = request["lens"]
    with pycolmap.Database.open(request["database"]) as database:
        (camera,) = database.read_all_cameras()
        camera.model = getattr(pycolmap.CameraModelId, lens["model"])
        camera.params = lens["params"]
        camera.has_prior_focal_length = lens["held"]
        database.update_camera(camera)
        pairs = [pycolmap.pair_id_to_image_pair(pair) for pair in database.read_num_matches()[0]]
        database.clear_two_view_geometries()
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = 0
    with _pair_list(request["database"]) as listed:
        listed.write_text("".join(f"{a} {b}\n" for a, b in pairs), encoding="utf-8")
        pycolmap.verify_matches(request["database"], listed, options)
    with pycolmap.Database.open(request["database"]) as database:
        return {"inliers": int(database.num_inlier_matches())}


@contextmanager
def _pair_list(file: str) -> Iterator[Path]:
    """Where a list of pairs may stand, a line each with the numbers of two images of the database `file`.

    COLMAP reads two names parted by a space, and those of people's pictures hold spaces. So the images have their
    numbers for names meanwhile.
    """
    listed = Path(file).with_suffix(".pairs.txt")
    with pycolmap.Database.open(file) as database:
        names = {image.image_id: image.name for image in database.read_all_images()}
    _rename_images(file, {number: str(number) for number in names})
    try:
        yield listed
    finally:
        _rename_images(file, names)
        listed.unlink(missing_ok=True)


def _rename_images(file: str, names: dict[int, str]) -> None:
    with pycolmap.Database.open(file) as database:
        for number, name in names.items():
            image = database.read_image(number)
            image.name = name
            database.update_image(image)


def incremental(request: Request) -> dict[str, Any]:
    """COLMAP's incremental mapper; the models are written to folders 0, 1, ... of the output, largest first.

    With `focal_last` the focal length, and of a lens that is `held` every parameter, is held until all frames have a
    place, and adjusted then.
    """
    options, held = incremental_options(request), request["held"]
    total, placed = len(request["names"]), [2]

    def count_image() -> None:
        placed[0] = min(placed[0] + 1, total)
        say({"done": placed[0], "of": total})

    models = pycolmap.incremental_mapping(
        request["database"], request["pictures"], request["scratch"], options=options, next_image_callback=count_image
    )
    if request["focal_last"] or held:
        for model in models.values():
            pycolmap.bundle_adjustment(model)
    return write_models(models, request)


def incremental_options(request: Request) -> Any:
    """COLMAP's options of the incremental mapper."""
    held = request["held"]
    refine = request["refine_focal"] and not request["focal_last"] and not held
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=request["threads"],
        random_seed=request["seed"],
        extract_colors=False,
        min_model_size=3,
        ba_refine_focal_length=refine,
        ba_refine_extra_params=not held,
        ba_global_frames_ratio=1.3,
        ba_global_points_ratio=1.3,
        ba_global_max_refinements=3,
    )
    # the steps of a video are small; COLMAP's 16 degrees suit photographs
    options.mapper.init_min_tri_angle = 6.0
    options.mapper.abs_pose_refine_focal_length = refine
    options.mapper.abs_pose_refine_extra_params = not held
    return options


def global_(request: Request) -> dict[str, Any]:
    """COLMAP's global mapper, on the named pictures; a lens that is `held` is adjusted at the end."""
    held = request["held"]
    options = pycolmap.GlobalPipelineOptions(
        num_threads=request["threads"], random_seed=request["seed"], image_names=request["names"]
    )
    options.mapper.bundle_adjustment.refine_focal_length = request["refine_focal"] and not held
    options.mapper.bundle_adjustment.refine_extra_params = not held
    models = pycolmap.global_mapping(request["database"], request["pictures"], request["scratch"], options=options)
    if held:
        for model in models.values():
            pycolmap.bundle_adjustment(model)
    return write_models(models, request)


def lenses(request: Request) -> dict[str, Any]:
    """How well each camera model does on observations that it was not fitted to, and the best of them."""
    scores = model_scores(request["model"])
    return {"scores": scores, "chosen": chosen_model(scores)}


STEPS: dict[str, Callable[[Request], dict[str, Any]]] = {
    "features": features,
    "matches": matches,
    "verification": verification,
    "incremental": incremental,
    "global": global_,
    "lenses": lenses,
}


def write_models(models: dict[int, Any], request: Request) -> dict[str, Any]:
    """The models as folders, largest first; of that one its camera, how sure its focal length is, and its triplets.

    Of the largest only the largest piece is kept that triplets hold together.
    """
    ordered = sorted(models.values(), key=lambda model: -model.num_reg_images())
    agreed = None if not ordered else _keep_largest_piece(ordered[0], request)
    rows = []
    for number, model in enumerate(ordered):
        if request["colours"]:
            model.extract_colors_for_all_images(request["pictures"])
        place = Path(request["output"]) / str(number)
        place.mkdir(parents=True)
        model.write_binary(str(place))
        rows.append({"images": model.num_reg_images(), "points": model.num_points3D()})
    result: dict[str, Any] = {"models": rows, "camera": [], "focal_deviation": None, "agreement": agreed}
    if ordered:
        result["camera"] = [float(value) for value in min(ordered[0].cameras.items())[1].params]
        # read again: the covariance also looks at frames that were taken out, and these have no pose
        result["focal_deviation"] = focal_deviation(pycolmap.Reconstruction(Path(request["output"]) / "0"))
    return result


def _keep_largest_piece(model: Any, request: Request) -> dict[str, Any]:
    """Take the frames of smaller pieces out of a model; how it agreed with its triplets before, as JSON."""
    agreed = agreement(model_triplets(model, request["database"]), model.num_reg_images())
    loose = set().union(*agreed.pieces[1:]) - set(agreed.pieces[0] if agreed.pieces else ())
    if loose:
        for image in [image for image in model.images.values() if image.has_pose and image.name in loose]:
            model.deregister_frame(image.frame_id)
        options = pycolmap.BundleAdjustmentOptions(print_summary=False)
        options.refine_focal_length = bool(request["refine_focal"])
        pycolmap.bundle_adjustment(model, options)
    return agreed.json()


def _strongest(database: Any, image_id: int) -> NDArray[np.float32]:
    """(k, 128) unit descriptors of the features of largest scale."""
    keypoints = np.asarray(database.read_keypoints(image_id))
    descriptors = np.asarray(database.read_descriptors(image_id).data, dtype=np.float32)
    if not len(keypoints):
        return np.empty((0, 128), dtype=np.float32)
    scale = np.hypot(keypoints[:, 2], keypoints[:, 4]) if keypoints.shape[1] >= 6 else keypoints[:, 2]
    top = descriptors[np.argsort(-scale, kind="stable")[:128]]
    return np.asarray(top / np.maximum(np.linalg.norm(top, axis=1, keepdims=True), 1e-6))


def _pair_row(database: Any, first: int, second: int) -> list[Any]:
    """Matches, inliers, kind of geometry, share of the inliers that one homography explains, motion in pixels, H."""
    raw = len(database.read_matches(first, second)) if database.exists_matches(first, second) else 0
    if not database.exists_two_view_geometry(first, second):
        return [raw, 0, "none", 0.0, 0.0, None]
    geometry = database.read_two_view_geometry(first, second)
    inliers = np.asarray(geometry.inlier_matches)
    if len(inliers) < 8:
        return [raw, len(inliers), pycolmap.TwoViewGeometryConfiguration(geometry.config).name, 0.0, 0.0, None]
    one = np.asarray(database.read_keypoints(first))[inliers[:, 0], :2]
    two = np.asarray(database.read_keypoints(second))[inliers[:, 1], :2]
    homography, share = _homography(one, two)
    moved = float(np.median(np.linalg.norm(two - one, axis=1)))
    return [raw, len(inliers), pycolmap.TwoViewGeometryConfiguration(geometry.config).name, share, moved, homography]


def _homography(one: NDArray[np.float32], two: NDArray[np.float32]) -> tuple[list[list[float]] | None, float]:
    """The homography between two pictures, points (n, 2) each, and the share of points within 2 px of it."""
    import cv2

    cv2.setRNGSeed(0)
    matrix, inside = cv2.findHomography(one, two, cv2.RANSAC, 2.0, maxIters=500)
    if matrix is None:
        return None, 0.0
    return matrix.tolist(), float(inside.mean())


def say(row: dict[str, Any]) -> None:
    """Print a line of progress, or the result, for the process that waits."""
    sys.stdout.write(json.dumps(row) + "\n")
    sys.stdout.flush()


def _end_with_parent(parent: int) -> None:
    """End when the process `parent` ends, and at once if it has ended already."""
    try:
        ctypes.CDLL(None, use_errno=True).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    except (OSError, AttributeError):  # not Linux: an orphan works on in a part folder that the next run removes
        return
    if os.getppid() != parent:  # it was killed before the line above: nobody else would end this process
        sys.exit(1)


def _end_after(seconds: int) -> None:
    """End when so many seconds of processor are used."""
    try:
        import resource
    except ImportError:  # not POSIX: the wall time of the waiting process counts
        return
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    if hard == resource.RLIM_INFINITY or seconds < hard:
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, hard))


def focal_deviation(model: Any) -> float | None:
    """Standard deviation of the focal length, as a share of it, if every observation were off by one pixel.

    model : a `pycolmap.Reconstruction`, whose bundle adjustment has converged.

    It is the square root of the focal length's entry in (J^T J)^-1, with the Jacobian J of all reprojection errors by
    poses, points and lens. None where the matrix cannot be inverted. A camera that moves without turning does not
    determine its focal length (Sturm 1999, "Critical motion sequences for the self-calibration of cameras"): scaling
    all depths by a factor and the focal length by the same gives the same pictures. The residuals of such a model are
    small, and only the deviation shows it. Of several cameras it is the median.
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
        of_lens = covariance.get_other_params_cov(camera.params)  # (p, p), the focal length first
        if of_lens is not None and of_lens[0, 0] >= 0:
            deviations.append(float(np.sqrt(of_lens[0, 0]) / camera.params[0]))
    return float(np.median(deviations)) if deviations and np.isfinite(deviations).all() else None


if __name__ == "__main__":
    run_step(sys.argv[1:], STEPS)
