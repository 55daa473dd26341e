"""Graph of the frames of a capture, with an edge for each pair of frames that has enough verified matches."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from metric_base.arrays import FloatArray, IntArray
from metric_base.input_files import read_json

#: Minimum number of verified matches of linked frames; as many as a frame needs to be placed.
MIN_LINK_INLIERS = 15
#: Minimum number of verified matches of pairs whose motion is tested; with fewer, chance matches show any motion.
MIN_TESTED_INLIERS = 30
#: Minimum motion of a pair, relative to the longer side, that is tested for a rotation.
MIN_TESTED_MOTION = 0.1
#: Maximum logarithm of the ratio of the singular values of K^-1 H K of a rotation, which are equal without noise.
MAX_ROTATION_MISFIT = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class FramePair:
    """Two frames that were matched."""

    first: int  #: Index of a frame.
    second: int
    inliers: int  #: Number of verified matches.
    moved_px: float  #: Their median motion.
    homography: FloatArray | None  #: (3, 3) matrix from first to second that explains them, if any.


@dataclass(frozen=True, slots=True, eq=False)
class MatchGraph:
    """Frames and their matched pairs."""

    names: list[str]  #: Files of the frames in order.
    keypoints: IntArray  #: (n,) number of features of each frame.
    pairs: tuple[FramePair, ...]
    size: tuple[int, int]  #: Width and height of the frames.
    edges: FloatArray  #: (n, 2) `edge_sharpness` of the frames.

    @classmethod
    def read(
        cls, databases: Path, suffix: str, names: list[str], size: tuple[int, int], edges: FloatArray
    ) -> MatchGraph:
        """Return the graph of frames, edges (n, 2), from the stages of features and matches in a folder."""
        keypoints = read_json(databases / f"features{suffix}.json")["keypoints"]
        pairs = tuple(
            FramePair(first, second, n, moved, None if matrix is None else np.array(matrix, dtype=np.float64))
            for first, second, n, moved, matrix in read_json(databases / f"matches{suffix}.json")["pairs"]
        )
        return cls(names, np.array([keypoints.get(name, 0) for name in names], dtype=np.int64), pairs, size, edges)

    @property
    def tested_pairs(self) -> tuple[FramePair, ...]:
        """Pairs with enough verified matches for a test of their motion."""
        return tuple(pair for pair in self.pairs if pair.inliers >= MIN_TESTED_INLIERS)

    def groups(self) -> list[list[int]]:
        """Return the indices of connected frames, largest group first."""
        n = len(self.names)
        linked = [(pair.first, pair.second) for pair in self.pairs if pair.inliers >= MIN_LINK_INLIERS]
        links = np.array(linked, dtype=np.int64).reshape(-1, 2)
        graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(n, n))
        count, labels = connected_components(graph, directed=False)
        return sorted((np.flatnonzero(labels == label).tolist() for label in range(count)), key=len, reverse=True)

    def rotation_ratio(self) -> float:
        """Return the ratio of the pairs with enough motion that a rotation of the camera explains."""
        side = max(self.size)
        moving = [pair for pair in self.tested_pairs if pair.moved_px > MIN_TESTED_MOTION * side]
        matrices = [pair.homography for pair in moving if pair.homography is not None]
        if not matrices:
            return 0.0
        # K^-1 H K at focal lengths of 0.4 to 3 times the longer side, of which one must explain all pairs
        focals = np.geomspace(0.4, 3.0, 25) * side
        k = np.tile(np.array([[0, 0, self.size[0] / 2], [0, 0, self.size[1] / 2], [0, 0, 1.0]]), (len(focals), 1, 1))
        k[:, 0, 0] = k[:, 1, 1] = focals
        values = np.linalg.svd(np.linalg.inv(k) @ np.array(matrices)[:, None] @ k, compute_uv=False)
        misfits = np.log(values[..., 0] / np.maximum(values[..., 2], 1e-12))  # (pairs, focal lengths)
        best = int(np.median(misfits, axis=0).argmin())
        return float((misfits[:, best] < MAX_ROTATION_MISFIT).sum() / len(moving))

    def edge_sharpness(self) -> tuple[float, float] | tuple[None, None]:
        """Return the medians of the least and the steepest edges of the frames; None if no frame has edges."""
        seen = self.edges[np.isfinite(self.edges).all(axis=1)]
        if not len(seen):
            return None, None
        low, high = np.median(seen, axis=0)
        return float(low), float(high)

    def summary(self) -> dict[str, Any]:
        """Return the figures for `reconstruction.json`."""
        linked = self.tested_pairs
        return {
            "frames": len(self.names),
            "keypoints": float(np.median(self.keypoints)) if len(self.keypoints) else 0.0,
            "matched": len(self.pairs),
            "linked": len(linked),
            "groups": [len(group) for group in self.groups()][:5],
            "rotation": self.rotation_ratio(),
            "moved": float(max((pair.moved_px for pair in linked), default=0.0)) / max(self.size),
            "edges": list(self.edge_sharpness()),
        }
