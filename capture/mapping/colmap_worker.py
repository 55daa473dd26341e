"""Steps of the reconstruction with COLMAP, in a separate process, because an abort in C++ ends the process.

`python -m capture.mapping.colmap_worker STEP REQUEST.json PARENT [SECONDS]` prints lines of JSON: `{"done": 3, "of":
40}` for progress and `{"result": ...}` at the end.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.mapping.features import N_THREADS, FeatureStrategy
from capture.mapping.incremental import compare_global, finish, mapping, match_pairs
from capture.mapping.pairs import all_pairs, chosen_pairs, coarse_scores
from estimator.reconstructions.pycolmap_library import pycolmap

Request = dict[str, Any]

#: Number of images, and of pairs, between two lines of progress.
N_IMAGES_AT_ONCE, N_PAIRS_AT_ONCE = 8, 150
#: Linux's prctl(PR_SET_PDEATHSIG): this process ends with the one that started it, even if that was killed.
_PARENT_DEATH_SIGNAL = 1
#: Number of features of largest scale by which loops are found.
N_COMPARED_FEATURES = 128
#: Pairs of which a homography explains the matches.
_KINDS = pycolmap.TwoViewGeometryConfiguration
PLANAR = (_KINDS.PLANAR, _KINDS.PANORAMIC, _KINDS.PLANAR_OR_PANORAMIC)


def run_step(words: Sequence[str], steps: Mapping[str, Callable[[Request], dict[str, Any]]]) -> None:
    """Run the named step on its request and print its result.

    Parameters
    ----------
    words : sequence of str
        Step, file of the request, id of the parent process and, optionally, seconds of processor time.
    steps : mapping
        Function of each step.
    """
    step, file, parent, *seconds = words
    try:
        ctypes.CDLL(None, use_errno=True).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    except (OSError, AttributeError, TypeError):
        pass  # not Linux: an orphan continues in a part folder that the next run removes
    else:
        if os.getppid() != int(parent):  # the parent was killed before the line above
            sys.exit(1)
    if seconds:
        try:
            import resource
        except ImportError:  # not POSIX: the wall time of the waiting process limits this one
            pass
        else:
            hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
            if hard == resource.RLIM_INFINITY or int(seconds[0]) < hard:
                resource.setrlimit(resource.RLIMIT_CPU, (int(seconds[0]), hard))
    request: Request = json.loads(Path(file).read_text(encoding="utf-8"))
    pycolmap.logging.minloglevel = 1
    print_row({"result": steps[step](request)})


def print_row(row: dict[str, Any]) -> None:
    """Print a line of progress, or the result, for the waiting process."""
    sys.stdout.write(json.dumps(row) + "\n")
    sys.stdout.flush()


def features(request: Request) -> dict[str, Any]:
    """Extract SIFT features of the named images into a new database, and return their number by name."""
    strategy = FeatureStrategy(**request["strategy"])
    extraction = pycolmap.FeatureExtractionOptions(num_threads=N_THREADS, max_image_size=strategy.max_side)
    extraction.sift.max_num_features = strategy.max_features
    extraction.sift.first_octave = strategy.first_octave
    extraction.sift.peak_threshold = strategy.peak
    extraction.sift.domain_size_pooling = extraction.sift.estimate_affine_shape = strategy.pooled
    done, n = 0, sum(len(camera["names"]) for camera in request["cameras"])
    for camera in request["cameras"]:
        reader = pycolmap.ImageReaderOptions(camera_model=request["camera_model"], camera_params=camera["params"])
        for start in range(0, len(camera["names"]), N_IMAGES_AT_ONCE):
            names = camera["names"][start : start + N_IMAGES_AT_ONCE]
            pycolmap.extract_features(
                request["database"],
                request["images"],
                image_names=names,
                camera_mode=pycolmap.CameraMode.SINGLE,
                reader_options=reader,
                extraction_options=extraction,
            )
            done += len(names)
            print_row({"done": done, "of": n})
            with pycolmap.Database.open(request["database"]) as database:
                reader.existing_camera_id = max(known.camera_id for known in database.read_all_cameras())
    with pycolmap.Database.open(request["database"]) as database:
        images = database.read_all_images()
        return {"keypoints": {image.name: int(database.num_keypoints_for_image(image.image_id)) for image in images}}


def matches(request: Request) -> dict[str, Any]:
    """Match the pairs that may overlap and verify them; return each pair with figures of its geometry."""
    names: list[str] = request["names"]
    strategy = FeatureStrategy(**request["strategy"])
    with pycolmap.Database.open(request["database"]) as database:
        ids = {image.name: image.image_id for image in database.read_all_images()}
        if len(names) <= strategy.exhaustive:
            pairs = all_pairs(len(names))
        else:
            strongest = [_strongest_descriptors(database, ids[name]) for name in names]
            pairs = chosen_pairs(coarse_scores(strongest), request["in_order"])
    matching = pycolmap.FeatureMatchingOptions(num_threads=N_THREADS, guided_matching=strategy.guided)
    matching.sift.max_ratio = strategy.ratio
    print_row({"done": 0, "of": len(pairs)})
    for start in range(0, len(pairs), N_PAIRS_AT_ONCE):
        some = [(ids[names[a]], ids[names[b]]) for a, b in pairs[start : start + N_PAIRS_AT_ONCE]]
        match_pairs(Path(request["database"]), some, matching)
        print_row({"done": start + len(some), "of": len(pairs)})
    with pycolmap.Database.open(request["database"]) as database:
        return {"pairs": [[a, b, *_pair_figures(database, ids[names[a]], ids[names[b]])] for a, b in pairs]}


def _strongest_descriptors(database: Any, image_id: int) -> NDArray[np.float32]:
    """Return the unit descriptors (k, 128) of the features of largest scale."""
    keypoints = np.asarray(database.read_keypoints(image_id))
    descriptors = np.asarray(database.read_descriptors(image_id).data, dtype=np.float32)
    if not len(keypoints):
        return np.empty((0, 128), dtype=np.float32)
    scale = np.hypot(keypoints[:, 2], keypoints[:, 4]) if keypoints.shape[1] >= 6 else keypoints[:, 2]
    top = descriptors[np.argsort(-scale, kind="stable")[:N_COMPARED_FEATURES]]
    return np.asarray(top / np.maximum(np.linalg.norm(top, axis=1, keepdims=True), 1e-6))


def _pair_figures(database: Any, first: int, second: int) -> list[Any]:
    """Return the number of inliers, their median motion in pixels, and the homography (3, 3) if it explains them.

    COLMAP decides that: with a ratio of 0.8 of the inliers of a fundamental matrix, the pair is planar or a rotation.
    """
    exists = database.exists_two_view_geometry(first, second)
    geometry = database.read_two_view_geometry(first, second) if exists else None
    if geometry is None or not len(geometry.inlier_matches):
        return [0, 0.0, None]
    inliers = np.asarray(geometry.inlier_matches)
    points, others = (
        np.asarray(database.read_keypoints(image))[inliers[:, side], :2] for side, image in enumerate((first, second))
    )
    moved = float(np.median(np.linalg.norm(others - points, axis=1)))
    is_planar = geometry.config in PLANAR and geometry.H is not None
    return [len(inliers), moved, np.asarray(geometry.H).tolist() if is_planar else None]


STEPS: dict[str, Callable[[Request], dict[str, Any]]] = {
    "features": features,
    "matches": matches,
    "mapping": lambda request: mapping(request, print_row),
    "finish": finish,
    "compare_global": compare_global,
}

if __name__ == "__main__":
    run_step(sys.argv[1:], STEPS)
