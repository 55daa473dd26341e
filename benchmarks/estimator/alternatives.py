"""Compare the posterior with alternatives to its rules, on scenes whose priors never saw their sizes.

    python -m benchmarks.estimator.alternatives --raw RAW --cache DIR [--tables TABLES] [--only WORDS]

Alternatives:

- offset removed, offset shared: the variance that a build adds to a prior for the offset of an unseen source
  (`metric_tree.fit.class_prior.NewSource`) is removed from it, or moved to the error that the objects of a scene share.
- scores halved: the probability of an outlier is 0.55 - 0.45 q for the score q, instead of 1 - 0.9 q.
- never mislabelled: the only object of a category is never mislabelled.
- outlines like points: few points do not lower the score of objects that are measured by their outlines.

Settings: synthetic rooms with masks and with boxes, and synthetic streets (seeds from 1000 on were used for choices),
rooms of ScanNet with all and with three objects, and streets of unseen sources (even ones were used for choices).
Columns: mean error and CRPS of ln scale, coverage and interval score of the 90 % interval, and the best factor of its
width. A second table has the ratio of the within-class standard deviation of the priors to that of true sizes, as the
median over classes, and a third one the offset of the sizes of streets from their priors (even streets).
"""

from __future__ import annotations

import pickle
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.accuracy.cases import synthetic_rooms, synthetic_streets
from benchmarks.accuracy.methods import UNTRACKED
from benchmarks.accuracy.outcomes import Outcome, crps_of, interval_scores, outcome_of
from benchmarks.accuracy.page import _WIDTHS
from benchmarks.accuracy.streets import MEASURED, NOISE, _scenes
from benchmarks.accuracy.unseen import FAMILY, SIGMA, rooms_of, sorted_extents, tree_without, unseen_tree
from benchmarks.common import SHARED, options_parser, print_rows
from estimator.pipeline import measure_objects
from estimator.posterior import object_likelihood, posterior
from estimator.records.objects import MeasuredObject
from estimator.results import estimate, object_priors
from estimator.results.estimate import scale_of_objects
from metric_base.arrays import FloatArray
from metric_tree.fit.class_prior import NEW_SOURCE
from metric_tree.prior import Prior
from metric_tree.tree import Tree

#: Number of rooms of ScanNet in each half, and of objects in the small scenes drawn from them.
MAX_ROOMS, FEW_OBJECTS = 300, 3
#: Minimum number of objects of a class in a ratio of standard deviations.
MIN_CLASS_OBJECTS = 20
#: Number of seeds of rooms of each kind and of streets.
N_SEEDS = 4
SEED = 1


@dataclass(frozen=True, slots=True)
class Scene:
    """Measured objects of a scene of known scale, and the tree of their priors."""

    setting: str
    objects: Sequence[MeasuredObject]
    scale: float
    tree: Tree


def main() -> None:
    """Print a row for each setting and alternative."""
    parser = options_parser(__doc__)
    parser.add_argument("--raw", type=Path, required=True, help="folder of raw items")
    parser.add_argument("--cache", type=Path, required=True, help="folder of the built trees and measured rooms")
    parser.add_argument("--tables", type=Path, default=SHARED / "sizes", help="folder with the tables of real rooms")
    parser.add_argument("--only", default="", help="settings whose names contain this text")
    arguments = parser.parse_args()
    every = _all_scenes(arguments.raw, arguments.cache, arguments.tables)
    scenes = [scene for scene in every if arguments.only in scene.setting]
    lines: dict[str, list[tuple[str, ...]]] = defaultdict(list)
    for name, alternative in ALTERNATIVES.items():
        with alternative():
            by_setting: dict[str, list[tuple[Outcome, float]]] = defaultdict(list)
            for scene in scenes:
                result = scale_of_objects(scene.objects, scene.tree)
                if result.curve is not None:
                    outcome = outcome_of("", scene.setting, "", "default", result, scene.scale)
                    by_setting[scene.setting].append((outcome, crps_of(result.curve, float(np.log(scene.scale)))))
        for setting, rows in by_setting.items():
            lines[setting].append((setting, name, *_statistics(rows)))
    columns = ("setting", "posterior", "scenes", "mean error", "CRPS", "coverage", "interval score", "best width")
    print_rows(list(columns), [line for of_setting in lines.values() for line in of_setting])
    print_rows(["classes of", "prior", "classes", "prior's sd / measured sd"], _spread_ratios(scenes))
    print_rows(["label", "objects", "axes", "ln of measured size / mean of the prior, median"], _street_offsets(scenes))


def _statistics(rows: Sequence[tuple[Outcome, float]]) -> tuple[str, ...]:
    answered = [outcome for outcome, _ in rows if np.isfinite(outcome.low)]
    error = np.mean([abs(np.expm1(outcome.error)) for outcome, _ in rows])
    covered = np.mean([outcome.low <= 0 <= outcome.high for outcome in answered])
    best = _WIDTHS[np.argmin([interval_scores(answered, width).mean() for width in _WIDTHS])]
    return (
        str(len(rows)), f"{100 * error:.1f}%", f"{np.mean([crps for _, crps in rows]):.4f}", f"{covered:.2f}",
        f"{interval_scores(answered).mean():.3f}", f"{best:.2f}",
    )  # fmt: skip


def _all_scenes(raw: Path, cache: Path, tables: Path) -> Iterator[Scene]:
    tree, sizes = unseen_tree(raw, cache)
    for first in (1000, 0):
        file = cache / f"measured-{first}.pickle"
        if not file.exists():
            seeds = range(first, first + N_SEEDS)
            cases = [*synthetic_rooms(seeds, sizes), *synthetic_streets(seeds, sizes)]
            measured = [
                (case.group, measure_objects(case.scene, case.instances, UNTRACKED).objects, case.scale)
                for case in cases
                if "sparse" not in case.group
            ]
            file.write_bytes(pickle.dumps(measured))
        for group, objects, scale in pickle.loads(file.read_bytes()):  # noqa: S301 - written by this program
            yield Scene(f"{group}, seeds from {first}", objects, scale, tree)
    rooms = rooms_of(tables / "scannet18_boxes" / "scannet18_boxes.csv")
    for half, name in enumerate(("even", "odd")):
        generator = np.random.default_rng([SEED, half])
        for room in sorted(rooms)[half::2][:MAX_ROOMS]:
            objects = [
                MeasuredObject(str(row), category, sorted_extents(size) / 1000, np.array(SIGMA))
                for row, (category, size) in enumerate(rooms[room])
            ]
            yield Scene(f"ScanNet, {name}", objects, 1.0, tree)
            few = generator.permutation(len(objects))[:FEW_OBJECTS]
            yield Scene(f"ScanNet, {name}, 3 objects", [objects[index] for index in few], 1.0, tree)
    streets = tree_without((*FAMILY, *MEASURED), raw, cache / "streets")
    generator = np.random.default_rng([SEED, 47])
    for index, (_, members) in enumerate(_scenes(tables, generator)):
        objects = [
            MeasuredObject(str(row), label, size / 1000 * np.exp(generator.normal(0, NOISE, 3)), np.full(3, NOISE))
            for row, (label, size) in enumerate(members)
        ]
        yield Scene(f"streets, {'odd' if index % 2 else 'even'}", objects, 1.0, streets)


@contextmanager
def _with_priors(change: Callable[[Prior], Prior]) -> Iterator[None]:
    """Change the priors of categories."""
    plain = object_priors.resolve_categories

    def resolve_categories(*arguments: Any, **options: Any) -> dict[str, object_priors.CategoryMatch]:
        matches = plain(*arguments, **options)
        return {
            name: match if match.prior is None else replace(match, prior=change(match.prior))
            for name, match in matches.items()
        }

    with patch.object(estimate, "resolve_categories", resolve_categories):
        yield


@contextmanager
def _with_arrays(change: Callable[..., Any]) -> Iterator[None]:
    """Change the measurements of the objects of a posterior."""
    plain = object_likelihood.measurement_arrays
    with patch.object(posterior, "measurement_arrays", lambda evidence: change(plain(evidence))):
        yield


def _halved(arrays: object_likelihood.MeasuredArrays) -> object_likelihood.MeasuredArrays:
    score = np.array([item.object.score for item in arrays.evidence])
    return replace(arrays, outlier=0.55 - 0.45 * score)


@cache
def without_offset(prior: Prior, is_shared: bool = False) -> Prior:
    """Return a prior of a release without the variance for an unseen source, or with it in the shared error."""
    if prior.evidence is None or prior.tier == "norm":
        return prior
    variance, sources = np.square(prior.log_sd()), prior.evidence.sources + 1
    # factor = 1 + min(most, sd^2 / fitted) / sources, and the published variance is factor * fitted
    fitted = variance - NEW_SOURCE.sd**2 / sources
    fitted = np.where(fitted >= NEW_SOURCE.sd**2 / NEW_SOURCE.most, fitted, variance / (1 + NEW_SOURCE.most / sources))
    scale = np.sqrt(np.outer(fitted / variance, fitted / variance))
    within, shared = scale * prior.covariances, scale * prior.shared_covariance
    if is_shared:
        shared = prior.shared_covariance + np.einsum("k,kij->ij", prior.weights, prior.covariances - within)
    return replace(prior, covariances=within, shared_covariance=shared)


def _spread_ratios(scenes: Sequence[Scene]) -> Iterator[tuple[str, ...]]:
    """Yield the ratio of the within-class standard deviation of the priors to that of true sizes, by source."""
    for setting in ("ScanNet", "streets"):
        sizes: dict[str, list[FloatArray]] = defaultdict(list)
        of_setting = [scene for scene in scenes if scene.setting in (f"{setting}, even", f"{setting}, odd")]
        if not of_setting:
            continue
        for scene in of_setting:
            for item in scene.objects:
                sizes[item.category].append(np.log(item.extents))
        matches = object_priors.resolve_categories(of_setting[0].tree, set(sizes))
        for name, change in (("as published", None), ("without offset", without_offset)):
            ratios = []
            for category, rows in sizes.items():
                prior = matches[category].prior
                if prior is None or set(prior.dims) - {"length", "width", "height"} or len(rows) < MIN_CLASS_OBJECTS:
                    continue
                prior = prior if change is None else change(prior)
                axes = [("length", "width", "height").index(dim) for dim in prior.dims]
                mean = prior.weights @ prior.means
                within = prior.weights @ (np.diagonal(prior.covariances, axis1=1, axis2=2) + (prior.means - mean) ** 2)
                noise = np.array(SIGMA if setting == "ScanNet" else (NOISE,) * 3)[axes] ** 2
                measured = np.maximum(np.var(np.array(rows)[:, axes], axis=0) - noise, 1e-4)
                ratios.append(float(np.sqrt(within.mean() / measured.mean())))
            yield setting, name, str(len(ratios)), f"{np.median(ratios):.2f}"


def _street_offsets(scenes: Sequence[Scene]) -> Iterator[tuple[str, ...]]:
    """Yield the offset of the measured sizes of each label of even streets from the mean of its prior."""
    sizes: dict[str, list[FloatArray]] = defaultdict(list)
    of_streets = [scene for scene in scenes if scene.setting == "streets, even"]
    for scene in of_streets:
        for item in scene.objects:
            sizes[item.category].append(np.log(1000 * item.extents))
    for category, match in object_priors.resolve_categories(of_streets[0].tree, set(sizes)).items() if sizes else ():
        if match.prior is not None and len(sizes[category]) >= MIN_CLASS_OBJECTS:
            axes = [("length", "width", "height").index(dim) for dim in match.prior.dims]
            offset = np.median(sizes[category], axis=0)[axes] - match.prior.weights @ match.prior.means
            shown = ", ".join(f"{value:+.2f}" for value in offset)
            yield category, str(len(sizes[category])), ", ".join(match.prior.dims), shown


@contextmanager
def _as_it_is() -> Iterator[None]:
    yield


ALTERNATIVES: dict[str, Callable[[], Any]] = {
    "as it is": _as_it_is,
    "offset removed": partial(_with_priors, without_offset),
    "offset shared": partial(_with_priors, partial(without_offset, is_shared=True)),
    "scores halved": partial(_with_arrays, _halved),
    "never mislabelled": partial(
        _with_arrays, lambda arrays: replace(arrays, mislabelled=np.zeros(len(arrays.evidence)))
    ),
    "outlines like points": partial(
        patch.object,
        object_priors,
        "_score_factor",
        lambda _, match: object_priors.BROADER_SCORE if match.is_broader else 1.0,
    ),
}


if __name__ == "__main__":
    main()
