"""Frames and matched pairs of a capture: a graph with groups of linked frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from capture.mapping.model_metrics import _rotation_misfit, _steps_from
from metric_base.arrays import FloatArray, IntArray

#: Verified matches that make two frames belong together.
LINKED = 30


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """Two frames that were matched.

    matches : before verification; inliers : after it; planar : share of these that one homography explains;
    moved_px : their median motion; homography : (3, 3) that one, or None.
    """

    first: int
    second: int
    matches: int
    inliers: int
    planar: float
    moved_px: float
    homography: FloatArray | None


@dataclass(frozen=True, slots=True, eq=False)
class CaptureEvidence:
    """Frames and their pairs.

    names : files of the chosen frames in order; keypoints : (n,) features of each; size : (width, height) of the
    frames; edges : (n, 2) steepness of the edges in the least and the most steep direction.
    """

    names: list[str]
    keypoints: IntArray
    pairs: tuple[Pair, ...]
    size: tuple[int, int]
    edges: FloatArray

    @property
    def linked_pairs(self) -> tuple[Pair, ...]:
        """Pairs with enough verified matches."""
        return tuple(pair for pair in self.pairs if pair.inliers >= LINKED)

    def groups(self) -> list[list[int]]:
        """Frames connected by linked pairs, largest group first."""
        parent = list(range(len(self.names)))

        def root(frame: int) -> int:
            while parent[frame] != frame:
                parent[frame] = parent[parent[frame]]
                frame = parent[frame]
            return frame

        for pair in self.linked_pairs:
            parent[root(pair.first)] = root(pair.second)
        members: dict[int, list[int]] = {}
        for frame in range(len(self.names)):
            members.setdefault(root(frame), []).append(frame)
        return sorted(members.values(), key=len, reverse=True)

    def most_steps(self) -> int:
        """Linked pairs from one frame to another, at most, within the largest group; an orbit or a room has few."""
        near: dict[int, set[int]] = {}
        for pair in self.linked_pairs:
            near.setdefault(pair.first, set()).add(pair.second)
            near.setdefault(pair.second, set()).add(pair.first)
        return max((_steps_from(frame, near) for frame in self.groups()[0]), default=0)

    def rotation_share(self) -> float:
        """Share of the linked pairs that move by a tenth of the picture or more and that a rotation alone explains."""
        side = max(self.size)
        moving = [pair for pair in self.linked_pairs if pair.moved_px > 0.1 * side]
        if not moving:
            return 0.0
        planar = [pair for pair in moving if pair.planar > 0.9 and pair.homography is not None]
        misfits = np.array(
            [_rotation_misfit(pair.homography, self.size) for pair in planar if pair.homography is not None]
        )
        if not len(misfits):
            return 0.0
        # (m, f) misfit of each pair at each focal length: one focal length must do for all
        best = int(np.median(misfits, axis=0).argmin())
        return float((misfits[:, best] < 0.03).sum() / len(moving))

    def edge_sharpness(self) -> tuple[float, float] | tuple[None, None]:
        """Median over the frames of their least and most steep edges; None where no frame has edges."""
        seen = self.edges[np.isfinite(self.edges).all(axis=1)]
        if not len(seen):
            return None, None
        low, high = np.median(seen, axis=0)
        return float(low), float(high)

    def summary(self) -> dict[str, Any]:
        """Figures for the report."""
        linked = self.linked_pairs
        return {
            "frames": len(self.names),
            "keypoints": float(np.median(self.keypoints)) if len(self.keypoints) else 0.0,
            "matched": len(self.pairs),
            "linked": len(linked),
            "groups": [len(group) for group in self.groups()][:5],
            "planar": float(np.median([pair.planar for pair in linked])) if linked else None,
            "rotation": self.rotation_share(),
            "moved": float(max((pair.moved_px for pair in linked), default=0.0)) / max(self.size),
            "edges": list(self.edge_sharpness()),
        }
