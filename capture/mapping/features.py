"""Strategies of feature extraction and matching."""

from __future__ import annotations

from dataclasses import dataclass

#: Threads of feature extraction and matching; the reference machine has two cores.
N_THREADS = 2


@dataclass(frozen=True, slots=True)
class FeatureStrategy:
    """Options of feature extraction and matching, by default the options of COLMAP."""

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
