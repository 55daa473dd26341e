"""Detect and match features by one of three strategies, and choose the next strategy after a failure.

The strategies are tried in the order of their cost, until a model is usable and contains nearly all frames, or until
the failure cannot be due to the features (`next_strategies`).
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from capture.mapping.camera_prior import Lens
from capture.mapping.match_graph import CaptureEvidence
from capture.mapping.pairs import pair_count
from capture.mapping.refusals import LEAST_FRAMES, TYPICAL_FOCAL, WHOLE_SHARE, Failure
from capture.mapping.worker import TimeLimit, run_worker
from metric_base.progress import ProgressCallback, silent

#: Threads of feature extraction and matching; the reference machine has two cores.
N_THREADS = 2
#: Failures that are due to the motion of the camera: other features show the same motion.
MOTION_FAILURES = frozenset({"static_camera", "pure_rotation"})
#: Failures that are due to the images, if they have few keypoints.
IMAGE_FAILURES = frozenset({"motion_blur", "no_texture"})
#: Maximum median number of keypoints of images in which no strategy finds more.
MAX_PLAIN_KEYPOINTS = 50


@dataclass(frozen=True, slots=True)
class FeatureStrategy:
    """Options of feature extraction and matching, with their cost relative to the first strategy."""

    name: str
    suffix: str  #: End of the names of its stages and databases.
    max_features: int  #: Maximum number of features per image.
    max_side: int  #: Maximum longer side of an image in pixels; larger images are reduced.
    first_octave: int  #: -1 doubles the image before the search.
    peak: float  #: Minimum contrast of a feature (`peak_threshold`).
    pooled: bool  #: Pool descriptors over domain sizes (Dong and Soatto 2015), which costs five times as much.
    guided: bool  #: Search for matches again along the epipolar lines.
    ratio: float  #: Maximum ratio of the nearest to the second nearest descriptor distance (Lowe).
    exhaustive: int  #: Maximum number of frames for matching all pairs.
    search_cost: float  #: Time per frame, relative to the first strategy.
    pair_cost: float  #: Time per pair of frames, relative to the first strategy.


#: Four times the features of the first strategy take four times as long and halve an error below a millimetre. The
#: second finds three to five times as many distinct points in small or weakly textured images. The third linked 50 and
#: 53 of all frames of two rooms with glossy floors, of which the first linked 13 and 35; it needs both its features and
#: guided matching. On four real sets the second took 3.4 to 4.1 times as long per frame as the first, and 2 to 4.1
#: times per pair; the costs of the third are those of pooling (5) and guiding (2).
STRATEGIES = (
    FeatureStrategy("SIFT", "", 2500, 1000, 0, 0.02 / 3, False, False, 0.8, 100, 1, 1),
    FeatureStrategy("fine SIFT", "_fine", 4000, 1200, -1, 0.004, False, False, 0.8, 60, 4, 4),
    FeatureStrategy("pooled SIFT, guided", "_pooled", 4000, 1000, -1, 0.003, True, True, 0.85, 55, 14, 5),
)


def make_features(
    folder: Path,
    images: Path,
    cameras: list[tuple[Lens, list[str]]],
    strategy: FeatureStrategy = STRATEGIES[0],
    *,
    limit: TimeLimit,
    progress: ProgressCallback = silent,
) -> None:
    """Write `features.db` and `features.json`, with the suffix of the strategy, to a folder.

    Parameters
    ----------
    folder, images : Path
        Existing folder for the outputs, and folder of the frames.
    cameras : list of (Lens, list of str)
        Each camera with the names of its frames.

    Raises
    ------
    OutOfTime
        The extraction was ended at the limit.
    """
    request = {
        "database": str(folder / f"features{strategy.suffix}.db"),
        "pictures": str(images),
        "camera_model": cameras[0][0].model,
        "cameras": [{"params": lens.params, "names": names} for lens, names in cameras],
        "focal_factor": TYPICAL_FOCAL,
        "sift": {
            "max_num_features": strategy.max_features,
            "first_octave": strategy.first_octave,
            "peak_threshold": strategy.peak,
            "domain_size_pooling": strategy.pooled,
            "estimate_affine_shape": strategy.pooled,
        },
        "max_side": strategy.max_side,
        "threads": N_THREADS,
    }
    n_frames = sum(len(names) for _, names in cameras)
    result = run_worker("features", request, folder, progress=progress, total=n_frames, limit=limit)
    (folder / f"features{strategy.suffix}.json").write_text(json.dumps(result), encoding="utf-8")


def make_matches(
    folder: Path,
    features: Path,
    names: list[str],
    in_order: bool,
    strategy: FeatureStrategy = STRATEGIES[0],
    *,
    limit: TimeLimit,
    progress: ProgressCallback = silent,
) -> None:
    """Write `matches.db` and `matches.json`, with the suffix of the strategy, to a folder.

    Parameters
    ----------
    folder, features : Path
        Existing folder for the outputs, and folder of `features.db`.
    names : list of str
        Frames to match.
    in_order : bool
        Whether the frames are from a video.

    Raises
    ------
    OutOfTime
        The matching was ended at the limit.
    """
    database = folder / f"matches{strategy.suffix}.db"
    shutil.copyfile(features / f"features{strategy.suffix}.db", database)
    request = {
        "database": str(database),
        "names": names,
        "in_order": in_order,
        "threads": N_THREADS,
        "guided": strategy.guided,
        "ratio": strategy.ratio,
        "exhaustive": strategy.exhaustive,
    }
    result = run_worker("matches", request, folder, progress=progress, limit=limit)
    (folder / f"matches{strategy.suffix}.json").write_text(json.dumps(result), encoding="utf-8")


def next_strategies(
    strategy: FeatureStrategy, failure: Failure | None, n_placed: int, evidence: CaptureEvidence, disputed: bool = False
) -> tuple[FeatureStrategy, ...]:
    """Return the strategies that may improve a model, cheapest first.

    Parameters
    ----------
    strategy : FeatureStrategy
        The strategy of the model.
    failure : Failure or None
        Why the model cannot be used.
    n_placed : int
        Number of frames in the model.
    evidence : CaptureEvidence
    disputed : bool
        Whether the mappers disagree about the path; the second strategy may settle which of them is right.
    """
    n_frames = len(evidence.names)
    code = None if failure is None else failure.code
    is_whole = n_placed >= WHOLE_SHARE * n_frames
    if code is None and is_whole:
        return STRATEGIES[1:2] if disputed and strategy == STRATEGIES[0] else ()
    if code == "focal_length_undetermined" and is_whole:
        return ()  # due to the motion of the camera, which more points do not change
    if n_frames < LEAST_FRAMES or code in MOTION_FAILURES:
        return ()
    if code in IMAGE_FAILURES and np.median(evidence.keypoints) < MAX_PLAIN_KEYPOINTS:
        return ()
    return STRATEGIES[STRATEGIES.index(strategy) + 1 :]


def model_rank(failed: bool, n_placed: int, n_frames: int, dispute: float) -> tuple[bool, bool, int, float]:
    """Return the sort key of a model: usable, then complete and undisputed, then the number of placed frames.

    dispute : difference of the mappers' paths as a fraction of their extent, 0 if it is negligible.
    """
    return not failed, n_placed >= WHOLE_SHARE * n_frames and not dispute, n_placed, -dispute


def predicted_s(
    strategy: FeatureStrategy, done: FeatureStrategy, spent_s: Mapping[str, float], n_frames: int, in_order: bool
) -> float:
    """Predict the seconds of a strategy from those of another one; 0 if these are unknown.

    spent_s : seconds by stage (`features`, `matches`, `mapping`, with the suffix of `done`).
    """
    stages = ("features", "matches", "mapping")
    features_s, matches_s, mapping_s = (spent_s.get(stage + done.suffix, 0.0) for stage in stages)
    pairs, pairs_done = (pair_count(n_frames, row.exhaustive, in_order) for row in (strategy, done))
    features_s *= strategy.search_cost / done.search_cost
    return features_s + matches_s * (pairs * strategy.pair_cost) / (max(pairs_done, 1) * done.pair_cost) + mapping_s
