"""What `study report` says of people whose eyes are known: `python -m benchmarks.insertion.study_simulation`.

Studies of 27 people, each of whom sees the eleven sizes twice: with a flat curve as the paper found (a peak of 0.65 at
-5 %), with a sharp one, with people who click at random, who always say "right", and with a third of random ones among
the rest. Printed: how often the curve is called flat, the error of the peak and of the just-noticeable step, and how
often their 95 % intervals hold the truth.
"""

from __future__ import annotations

import argparse

import numpy as np

from insertion.study.answers import ANSWERS, StudyAnswer
from insertion.study.curve import Observer, StudyCurve, curve_of
from insertion.study.page import STEPS
from insertion.study.plan import BIAS_SPREAD, FLAT, expected_intervals

__all__ = ["main", "simulated_answers"]

#: People of a study, and how often each size is shown to each.
PEOPLE, REPEATS = 27, 2
SHARP = Observer(bias=float(-np.log(0.95)), sigma=0.06, criterion=0.08)
#: Name, observer (None: no look at the picture), share of people who click at random, share who always say "right".
CASES = (
    ("flat, peak 0.65 at -5 %", FLAT, 0.0, 0.0),
    ("sharp, peak at -5 %", SHARP, 0.0, 0.0),
    ("a third click at random, the rest sharp", SHARP, 1 / 3, 0.0),
    ("a third click at random, the rest flat", FLAT, 1 / 3, 0.0),
    ("a third always say right, the rest sharp", SHARP, 0.0, 1 / 3),
    ("all click at random", None, 1.0, 0.0),
    ("all always say right", None, 0.0, 1.0),
)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=40)
    options = parser.parse_args()
    peak, step = expected_intervals(PEOPLE, REPEATS)
    print(f"the plan for a flat curve: the peak within {peak:.1f} %, the just-noticeable step within {step:.1f} %")
    print(f"{options.studies} studies of {PEOPLE} people, each size shown {REPEATS} times")
    print(
        "| people | called flat | careless | peak, off by | interval holds it | noticeable step | interval holds it |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, observer, random, right in CASES:
        curves = [
            curve_of(simulated_answers(observer, PEOPLE, REPEATS, seed, random, right))
            for seed in range(options.studies)
        ]
        print(_row(name, observer, curves), flush=True)


def simulated_answers(
    observer: Observer | None, people: int, repeats: int, seed: int, random: float = 0.0, right: float = 0.0
) -> list[StudyAnswer]:
    """The answers of people with this observer, each with a bias of their own; shares of others as `CASES` has them."""
    generator = np.random.default_rng(seed)
    steps = np.array(STEPS, dtype=float)
    answers = []
    for person in range(people):
        if person < round(random * people):
            shares = np.full((len(steps), 3), 1 / 3)
        elif observer is None or person < round((random + right) * people):
            shares = np.tile([0.0, 1.0, 0.0], (len(steps), 1))
        else:
            own = observer.bias + generator.normal(0, BIAS_SPREAD)
            shares = Observer(own, observer.sigma, observer.criterion).shares(steps)
        for _ in range(repeats):
            answers += [
                StudyAnswer(str(person), float(step), ANSWERS[generator.choice(3, p=share / share.sum())])
                for step, share in zip(steps, shares, strict=True)
            ]
    return answers


def _row(name: str, observer: Observer | None, curves: list[StudyCurve]) -> str:
    flat = sum(curve.flat for curve in curves)
    peaked = [curve for curve in curves if not curve.flat]
    if observer is None or not peaked:
        return f"| {name} | {flat} of {len(curves)} | | | | | |"
    # over people, sigma and their own biases add
    noticeable = Observer(0, float(np.hypot(observer.sigma, BIAS_SPREAD)), 1).noticeable
    peak = float(np.median([curve.observer.peak for curve in peaked])) - observer.peak
    step = float(np.median([curve.observer.noticeable for curve in peaked]))
    held = [sum(_holds(getattr(c, field), true) for c in peaked) for field, true in
            (("peak_interval", observer.peak), ("noticeable_interval", noticeable))]  # fmt: skip
    widths = np.median([np.ptp(c.peak_interval) for c in peaked if c.peak_interval])
    careless = np.mean([curve.careless for curve in peaked])
    return (
        f"| {name} | {flat} of {len(curves)} | {careless:.1f} | {peak:+.1f} % "
        f"| {held[0]} of {len(peaked)}, {widths:.0f} % wide "
        f"| {step:.1f} % (true {noticeable:.1f}) | {held[1]} of {len(peaked)} |"
    )


def _holds(interval: tuple[float, float] | None, true: float) -> bool:
    return interval is not None and interval[0] <= true <= interval[1]


if __name__ == "__main__":
    main()
