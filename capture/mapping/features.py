"""Strategies of feature extraction and matching, and their stages."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path

from capture.mapping.camera_prior import Lens
from capture.mapping.worker import TimeLimit, run_worker
from metric_base.progress import ProgressCallback, silent

#: Threads of feature extraction and matching; the reference machine has two cores.
N_THREADS = 2


@dataclass(frozen=True, slots=True)
class FeatureStrategy:
    """Options of feature extraction and matching, by default those of COLMAP."""

    name: str
    suffix: str  #: End of the names of its stages and databases.
    max_features: int = 8192  #: Maximum number of features per image.
    max_side: int = 3200  #: Maximum longer side of an image in pixels; larger images are reduced.
    first_octave: int = -1  #: -1 doubles the image before the search.
    peak: float = 0.02 / 3  #: Minimum contrast of a feature (`peak_threshold`).
    pooled: bool = False  #: Pool descriptors over domain sizes (Dong and Soatto 2015), with affine shapes.
    guided: bool = False  #: Search for matches again along the epipolar lines.
    ratio: float = 0.8  #: Maximum ratio of the nearest to the second nearest descriptor distance (Lowe).
    exhaustive: int = 150  #: Maximum number of frames for matching all pairs.


#: A first try on large images, where it costs a tenth of `MAIN`: it finds the same model of easy captures.
QUICK = FeatureStrategy("quick SIFT", "_quick", max_features=2500, max_side=1000, first_octave=0)
#: COLMAP's defaults.
MAIN = FeatureStrategy("SIFT", "")
#: It placed 50 and 53 of all frames of two rooms with glossy floors, of which plain SIFT placed 13 and 35; it needs
#: both its features and guided matching.
POOLED = FeatureStrategy(
    "pooled SIFT, guided", "_pooled", 4000, 1000, peak=0.003, pooled=True, guided=True, ratio=0.85, exhaustive=55
)
STRATEGIES = (QUICK, MAIN, POOLED)


def make_features(
    folder: Path,
    images: Path,
    cameras: list[tuple[Lens, list[str]]],
    strategy: FeatureStrategy = MAIN,
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
        "images": str(images),
        "camera_model": cameras[0][0].model,
        "cameras": [
            {"params": "" if lens.focal_px is None else ",".join(map(repr, lens.params)), "names": names}
            for lens, names in cameras
        ],
        "strategy": asdict(strategy),
    }
    result = run_worker("features", request, folder, progress=progress, limit=limit)
    (folder / f"features{strategy.suffix}.json").write_text(json.dumps(result), encoding="utf-8")


def make_matches(
    folder: Path,
    features: Path,
    names: list[str],
    in_order: bool,
    strategy: FeatureStrategy = MAIN,
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
        "strategy": asdict(strategy),
    }
    result = run_worker("matches", request, folder, progress=progress, limit=limit)
    (folder / f"matches{strategy.suffix}.json").write_text(json.dumps(result), encoding="utf-8")
