"""Processor milliseconds of the posterior with the tree loaded: 5, 20, 50 and 200 objects, the class error included.

    python -m benchmarks.estimator.posterior [--tree REF]

Objects are those of `benchmarks.estimator.simulation` (5 % with a wrong label), whole or with a side cut in one of
five. Timed is `estimator.posterior.posterior.posterior`, from measured objects and priors to scale, modes, interval and
weights. The best of the runs is what the machine can do, the median what it did beside its other work. The last column
is scikit-learn's `GaussianMixture.score_samples` of the same priors on the same grid of scales: the product of the
paper, one call for each object, without class errors, hypotheses, outliers, truncation, modes and weights.
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

__all__ = ["main", "milliseconds", "score_samples_milliseconds"]

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


def score_samples_milliseconds(evidence: Sequence[ObjectEvidence], runs: int) -> float:
    """Best milliseconds of scikit-learn's densities of all objects on the grid of the posterior."""
    from sklearn.mixture import GaussianMixture

    u = posterior(evidence).coarse
    terms = []
    for item in evidence:
        prior = item.prior
        model = GaussianMixture(n_components=len(prior.weights))
        covariances = prior.covariances + prior.disagreement()
        model.weights_, model.means_, model.covariances_ = prior.weights, prior.means, covariances
        model.precisions_cholesky_ = np.linalg.inv(np.linalg.cholesky(covariances)).transpose(0, 2, 1)
        terms.append((model, np.log(item.object.extents * 1000) + u[:, None]))
    times = []
    for _ in range(runs):
        started = time.process_time()
        sum(model.score_samples(sizes) for model, sizes in terms)
        times.append(1e3 * (time.process_time() - started))
    return min(times)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the times."""
    parser = argparse.ArgumentParser(description="Milliseconds of the posterior.")
    parser.add_argument("--tree", help="release with the priors")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(argv)
    classes = world(metric_tree.open(options.tree), None, 0, baselines=False)
    print(f"{'objects':>7} {'cut':>5} {'classes':>7} {'best ms':>8} {'median ms':>9} {'sklearn ms':>10}")
    for count in COUNTS:
        for cut in (0.0, 0.2):
            knobs = Knobs(objects=count, cut=cut)
            _, objects = simulated(classes, knobs, np.random.default_rng(options.seed))
            evidence = [ObjectEvidence(item, classes.priors[said], classes.nodes[said].pose) for said, item in objects]
            best, median = milliseconds(evidence, options.runs)
            kinds = len({said for said, _ in objects})
            plain = score_samples_milliseconds(evidence, max(options.runs // 10, 3))
            print(f"{count:>7} {cut:>5.0%} {kinds:>7} {best:>8.2f} {median:>9.2f} {plain:>10.2f}", flush=True)
    print(f"goal: {TARGET_MS} ms for {TARGET_OBJECTS} objects")
    return 0


if __name__ == "__main__":
    sys.exit(main())
