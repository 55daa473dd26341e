"""Processor time and memory of the association of many masks, without the rest of a scene.

    python -m benchmarks.estimator.mask_growth [--views N] [--chained]

Each view shows 50 of 100 objects of one category, with a few points of a neighbour in each mask. `--chained`: every
tenth mask holds its neighbour too, so that strong overlaps chain all masks into one part.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from estimator.association.point_labels import PointLabels
from estimator.association.tracks import shared_tracks
from estimator.records.scene import Instance
from estimator.visibility.sights import indicator

OBJECTS, SHOWN, POINTS = 100, 50, 100


def main() -> None:
    """Print masks, tracks, processor seconds of the association, and the peak memory of the process in MiB."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, default=400)
    parser.add_argument("--chained", action="store_true")
    options, random = parser.parse_args(), np.random.default_rng(0)
    points = np.repeat(random.uniform(-3, 3, (OBJECTS, 3)), POINTS, axis=0)
    points += random.normal(0, 0.1, points.shape)
    instances, members, seen = [], [], []
    for view in range(options.views):
        own = []
        for k in random.permutation(OBJECTS)[:SHOWN]:
            held = k * POINTS + np.flatnonzero(random.random(POINTS) < 0.6)
            both = options.chained and random.random() < 0.1
            few = np.flatnonzero(random.random(POINTS) < 0.6) if both else random.integers(0, POINTS, 3)
            neighbour = (k + 1) % OBJECTS * POINTS + few
            own.append(np.union1d(held, neighbour))
            instances.append(Instance(f"{view}-{k}", view, "cup", np.ones((1, 1), dtype=bool), (0, 0)))
        members += own
        seen.append(np.unique(np.concatenate(own)))
    inside, visible = indicator(members, len(points)), indicator(seen, len(points))
    labels = PointLabels(points, np.arange(len(points)), inside, visible, visible, inside)
    start = time.process_time()
    tracks = shared_tracks(instances, [labels])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{len(instances):,} masks, {len(tracks)} tracks, {time.process_time() - start:.1f} s, {peak:.0f} MiB")


if __name__ == "__main__":
    main()
