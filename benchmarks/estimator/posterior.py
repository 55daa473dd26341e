"""Processor milliseconds of the posterior with the tree loaded: 5, 20, 50 and 200 objects, the class error included.

    python -m benchmarks.estimator.posterior [--tree REF]

Objects are those of `benchmarks.estimator.simulation` (5 % with a wrong label), whole or with a side cut in one of
five. Timed is
`estimator.posterior.posterior.posterior`, from measured objects and priors to scale, modes, interval and weights. The
best of the
runs is what the machine can do, the median what it did beside its other work.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence

import numpy as np

import metric_tree
from benchmarks.estimator.simulation import Knobs, simulated, world
from estimator.posterior.likelihood import ObjectEvidence
from estimator.posterior.posterior import posterior

__all__ = ["main", "milliseconds"]

COUNTS = (5, 20, 50, 200)

#: The goal for 50 objects, hypotheses of sameness included, in ms on a machine without other work.
TARGET_OBJECTS, TARGET_MS = 50, 3.0


def milliseconds(evidence: Sequence[ObjectEvidence], runs: int) -> tuple[float, float]:
    """Best and median milliseconds of the posterior; the first run, which fills the tables, does not count."""
    posterior(evidence)
    times = []
    for _ in range(runs):
        started = time.process_time()
        posterior(evidence)
        times.append(1e3 * (time.process_time() - started))
    return min(times), float(np.median(times))


def main(argv: Sequence[str] | None = None) -> int:
    """Print the times."""
    parser = argparse.ArgumentParser(description="Milliseconds of the posterior.")
    parser.add_argument("--tree", help="release with the priors")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(argv)
    classes = world(metric_tree.open(options.tree), None, 0, baselines=False)
    print(f"{'objects':>7} {'cut':>5} {'classes':>7} {'best ms':>8} {'median ms':>9}")
    for count in COUNTS:
        for cut in (0.0, 0.2):
            knobs = Knobs(objects=count, cut=cut)
            _, objects = simulated(classes, knobs, np.random.default_rng(options.seed))
            evidence = [ObjectEvidence(item, classes.priors[said], classes.nodes[said].pose) for said, item in objects]
            best, median = milliseconds(evidence, options.runs)
            kinds = len({said for said, _ in objects})
            print(f"{count:>7} {cut:>5.0%} {kinds:>7} {best:>8.2f} {median:>9.2f}", flush=True)
    print(f"goal: {TARGET_MS} ms for {TARGET_OBJECTS} objects")
    return 0


if __name__ == "__main__":
    sys.exit(main())
