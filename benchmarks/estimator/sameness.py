"""How alike the objects of one class are within a room: shares learned from the rooms of ScanNet.

    python -m benchmarks.estimator.sameness [FILE ...]

FILE : tables of `../shared/data/sizes` with `category`, `instance_or_n` (room/object) and the three lengths in mm; by
default `scannet18_boxes` and `scannet_fine_boxes`. For each class with `LEAST_ROOMS` rooms that show two objects or
more, log extents are whitened by the class's own mean and covariance; a room with share rho then has objects of
correlation rho. Weights of the shares are fitted by expectation and maximisation, over the three sides and over the
heights alone (axis boxes blur the horizontal sides of turned things, so that their shares come out low).
`estimator.posterior.sameness.KIND_WEIGHTS` is read off the means over classes.
"""

from __future__ import annotations

import csv
import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["main", "share_weights"]

FILES = tuple(Path(f"../shared/data/sizes/{name}/{name}.csv") for name in ("scannet18_boxes", "scannet_fine_boxes"))
SHARES = np.array([0.0, 0.3, 0.6, 0.9, 0.98])
LEAST_ROOMS = 20
#: Rescans of a room repeat its objects: only the first scan counts.
FIRST_SCAN = "_00"
#: Sizes beyond this many deviations are clipped: they are other things or halves of them.
CLIPPED_SD = 3.0
#: Added to the spread of a class, whose sides may all be one number.
LEAST_SD = 0.01


def rooms_of(file: Path) -> dict[str, list[FloatArray]]:
    """Log extents (n, 3) of each room with several objects, by category."""
    rows: dict[str, dict[str, list[list[float]]]] = defaultdict(lambda: defaultdict(list))
    with file.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            room = row["instance_or_n"].partition("/")[0]
            sizes = [row[f"{axis}_mm"] for axis in ("length", "width", "height")]
            if room.endswith(FIRST_SCAN) and all(sizes) and all(float(size) > 0 for size in sizes):
                rows[row["category"]][room].append([float(size) for size in sizes])
    return {name: [np.log(sizes) for sizes in rooms.values()] for name, rooms in rows.items()}


def share_weights(rooms: Sequence[FloatArray]) -> FloatArray:
    """(s,) weights of `SHARES` over rooms of whitened extents (n, d)."""
    log_likelihood = np.array([[_log_likelihood(room, share) for share in SHARES] for room in rooms])
    weights = np.full(len(SHARES), 1 / len(SHARES))
    for _ in range(300):
        part = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True)) * weights
        weights = (part / part.sum(axis=1, keepdims=True)).mean(axis=0)
    return np.asarray(weights)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the weights of each class and their mean."""
    files = [Path(word) for word in (sys.argv[1:] if argv is None else argv)] or FILES
    for file in files:
        for sides, label in (([0, 1, 2], "three sides"), ([2], "heights")):
            print(f"{file.stem}, {label}: share {'  '.join(f'{share:4.2f}' for share in SHARES)}   mean")
            found = {}
            for name, rooms in rooms_of(file).items():
                several = [room for room in _whitened([room[:, sides] for room in rooms]) if len(room) > 1]
                if len(several) >= LEAST_ROOMS:
                    found[name] = share_weights(several)
            for name, weights in [*found.items(), ("mean of the classes", np.mean(list(found.values()), axis=0))]:
                print(f"  {name:24} {'  '.join(f'{w:4.2f}' for w in weights)}   {weights @ SHARES:.2f}")
    return 0


def _whitened(rooms: Sequence[FloatArray]) -> list[FloatArray]:
    together = np.concatenate(rooms)
    middle, spread = np.median(together, axis=0), together.std(axis=0)
    clipped = [np.clip(room - middle, -CLIPPED_SD * spread, CLIPPED_SD * spread) for room in rooms]
    covariance = np.atleast_2d(np.cov(np.concatenate(clipped).T)) + LEAST_SD**2 * np.eye(together.shape[1])
    turn = np.linalg.inv(np.linalg.cholesky(covariance)).T
    return [room @ turn for room in clipped]


def _log_likelihood(room: FloatArray, share: float) -> float:
    """Of n whitened objects (n, d) whose correlation is `share` on every side."""
    n, mean = len(room), room.mean(axis=0)
    within = ((room - mean) ** 2).sum(axis=0)
    together = 1 + (n - 1) * share
    terms = (n - 1) * np.log(1 - share) + np.log(together) + within / (1 - share) + n * mean**2 / together
    return float(-0.5 * terms.sum())


if __name__ == "__main__":
    sys.exit(main())
