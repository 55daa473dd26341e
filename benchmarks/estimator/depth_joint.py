"""Objects and a metric depth network together against each alone, on simulated scenes.

`OMP_NUM_THREADS=1 python -m benchmarks.estimator.depth_joint`. A network's metres are off by a common factor, and each
of twelve pictures by one of its own; what is stated of the first is the truth, the second is learned (`metric_depth`).
"""

from __future__ import annotations

import numpy as np

import metric_tree
from benchmarks.estimator.simulation import Knobs, simulated, world
from estimator.evidence.metric_depth import frame_sd
from estimator.posterior.likelihood import ObjectEvidence
from estimator.posterior.posterior import Estimate, posterior
from estimator.records.scale_evidence import DOUBT

SCENES, PICTURES, FRAME_ERROR = 300, 12, 0.1


def main() -> None:
    classes = world(metric_tree.open(), baselines=False)
    print(
        "| objects | network off by | error: objects | network | joint | coverage: objects | joint |\n|---"
        + "|---" * 6
        + "|"
    )
    for count in (3, 8):
        for sd in (0.05, 0.1, 0.2):
            errors, held = [], []
            for number in range(SCENES):
                generator = np.random.default_rng([11, number, count])
                scale, objects = simulated(classes, Knobs(objects=count, wrong=0.1), generator)
                items = [ObjectEvidence(one, classes.priors[said], classes.nodes[said].pose) for said, one in objects]
                off = generator.normal(0, sd) + generator.normal(0, FRAME_ERROR, PICTURES)
                middle = float(np.log(scale) + np.median(off))
                line = np.array([[middle, np.hypot(sd, frame_sd(off) / np.sqrt(PICTURES)), DOUBT]])
                found = [posterior(items), posterior(items, line)]
                guesses = [found[0].modes[0].scale, np.exp(middle), found[1].modes[0].scale]
                errors.append([abs(guess / scale - 1) for guess in guesses])
                held.append([_holds(one, scale) for one in found])
            mean, share = np.mean(errors, axis=0), np.mean(held, axis=0)
            cells = [f"{value:.1%}" for value in mean] + [f"{value:.2f}" for value in share]
            print(f"| {count} | {sd} | " + " | ".join(cells) + " |", flush=True)


def _holds(estimate: Estimate, scale: float) -> bool:
    return estimate.interval[0] <= scale <= estimate.interval[1]


if __name__ == "__main__":
    main()
