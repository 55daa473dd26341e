"""The ladder of searches for features and matches, cheapest first, and when the next one is worth its time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.capture.mapping.evidence import CaptureEvidence
from estimator.capture.mapping.failures import Failure
from estimator.capture.mapping.gates import LEAST_FRAMES, WHOLE_SHARE
from estimator.capture.mapping.pair_choice import pair_count

__all__ = ["RUNGS", "Rung", "model_rank", "next_rungs", "predicted_s"]

#: Failures that are of the camera's motion: other features show the same motion.
OF_THE_MOTION = frozenset({"static_camera", "pure_rotation"})
#: Smeared or plain pictures, with no more distinct points than this, have nothing that a finer search finds.
OF_THE_PICTURES, FEW_KEYPOINTS = frozenset({"motion_blur", "no_texture"}), 50


@dataclass(frozen=True, slots=True)
class Rung:
    """One way to search for features and to match them.

    suffix : of its databases and stages; max_side : longer side of the pictures that are searched; first_octave : -1
    doubles the picture first; peak : least contrast; pooled : descriptors are pooled over domain sizes (Dong and Soatto
    2015), which costs five times as much; guided : matches are searched again along the epipolar lines; ratio : Lowe's;
    exhaustive : up to so many frames are matched each with each; search_cost, pair_cost : time for a frame and for a
    pair of frames, over that of the first rung.
    """

    name: str
    suffix: str
    max_features: int
    max_side: int
    first_octave: int
    peak: float
    pooled: bool
    guided: bool
    ratio: float
    exhaustive: int
    search_cost: float
    pair_cost: float

    @property
    def sift(self) -> dict[str, Any]:
        """Options of the search as COLMAP names them."""
        return {
            "max_num_features": self.max_features,
            "first_octave": self.first_octave,
            "peak_threshold": self.peak,
            "domain_size_pooling": self.pooled,
            "estimate_affine_shape": self.pooled,
        }

    @property
    def matching(self) -> dict[str, Any]:
        """Options of the matching, for JSON."""
        return {"guided": self.guided, "ratio": self.ratio, "exhaustive": self.exhaustive}


#: Four times the features of the first take four times as long and halve an error that is below a millimetre. The
#: second finds three to five times as many distinct points in small or weakly textured pictures. The third linked 50
#: and 53 of all frames of two rooms with glossy floors, of which the first linked 13 and 35; neither its features nor
#: its guided matching was enough alone. On four real sets the second took 3.4 to 4.1 times as long for a frame as the
#: first, and 2 to 4.1 times for a pair; the third's costs are those of its pooling (5) and guiding (2).
RUNGS = (
    Rung("SIFT", "", 2500, 1000, 0, 0.02 / 3, False, False, 0.8, exhaustive=100, search_cost=1, pair_cost=1),
    Rung("fine SIFT", "_fine", 4000, 1200, -1, 0.004, False, False, 0.8, exhaustive=60, search_cost=4, pair_cost=4),
    Rung(
        "pooled SIFT, guided",
        "_pooled",
        4000,
        1000,
        -1,
        0.003,
        True,
        True,
        0.85,
        exhaustive=55,
        search_cost=14,
        pair_cost=5,
    ),
)


def next_rungs(
    rung: Rung, failure: Failure | None, placed: int, evidence: CaptureEvidence, disputed: bool = False
) -> tuple[Rung, ...]:
    """The rungs above this one that may mend the failure it ended with, or place more than so many of the frames.

    disputed : the mappers' paths differ; where nothing else is wrong, the second rung may settle which is right.
    """
    n = len(evidence.names)
    if failure is None and placed >= WHOLE_SHARE * n:
        return RUNGS[1:2] if disputed and rung == RUNGS[0] else ()
    if failure is not None and failure.code == "focal_length_undetermined" and placed >= WHOLE_SHARE * n:
        return ()  # it is the motion of the camera, which more points do not change
    if n < LEAST_FRAMES or (failure is not None and failure.code in OF_THE_MOTION):
        return ()
    if failure is not None and failure.code in OF_THE_PICTURES and np.median(evidence.keypoints) < FEW_KEYPOINTS:
        return ()
    return RUNGS[RUNGS.index(rung) + 1 :]


def model_rank(failed: bool, placed: int, n_frames: int, dispute: float) -> tuple[bool, bool, int, float]:
    """What of the models of several rungs counts: that one can be used, is whole and not disputed, what it places.

    dispute : by how much of the path's extent the mappers differ, 0 where that is too little to count.
    """
    return not failed, placed >= WHOLE_SHARE * n_frames and not dispute, placed, -dispute


def predicted_s(rung: Rung, done: Rung, spent: Mapping[str, float], n_frames: int, in_order: bool) -> float:
    """Seconds that a rung will take by those that another took; 0 where these are not known.

    spent : by stage (`features`, `matches`, `mapping` with the rung's suffix), of this run; in_order : of a video.
    """
    search, matching, mapping = (spent.get(stage + done.suffix, 0.0) for stage in ("features", "matches", "mapping"))
    pairs = [pair_count(n_frames, row.exhaustive, in_order) for row in (rung, done)]
    searching = search * rung.search_cost / done.search_cost
    return searching + matching * (pairs[0] * rung.pair_cost) / (max(pairs[1], 1) * done.pair_cost) + mapping
