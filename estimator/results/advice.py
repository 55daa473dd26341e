"""Suggest the measurements that would narrow the interval most (`suggest_measurements`).

The result of a measurement is unknown, so each is simulated at a few equally probable scales of the current posterior:
the object gets the size of its class at that scale, or the known length states that scale, and the posterior is
computed again: only the likelihood of that class, or the other evidence, changes. The stated narrowing is the mean
relative decrease of the log width of the interval.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from estimator.evidence.known_lengths import MIDDLE_ERROR
from estimator.posterior import log_scale_grid
from estimator.posterior.axis_assignments import is_sorted, prior_axes
from estimator.posterior.object_likelihood import ObjectEvidence
from estimator.posterior.posterior import Posterior, posterior
from estimator.posterior.shared_error import shared_error
from estimator.records.objects import MeasuredObject
from estimator.records.result import Help
from estimator.results.object_priors import CategoryMatch, EvidenceSet, resolve_categories, visible_truncations
from metric_base.arrays import BoolArray, FloatArray
from metric_tree.tree import Tree

#: Quantiles of the posterior at which a measurement is simulated: centres of three parts with equal mass.
SUPPOSED_QUANTILES = (1 / 6, 1 / 2, 5 / 6)
#: Standard deviation of the log size of a well measured object.
MEASURED_SD_LOG = 0.05
#: Standard deviation of the log of a length measured with a tape.
TAPE_SD_LOG = 0.01
#: Minimum probability of not being an outlier for an object whose size is suggested as a known length.
MIN_INLIER_PROBABILITY = 0.5
#: Classes of known size that are frequent in rooms or streets, so that one without a mask may be in the scene.
SUGGESTED_CATEGORIES = ("chair", "table", "door", "person")
#: Minimum relative narrowing of a suggestion; less is not worth the effort.
MIN_NARROWING = 0.05
#: Maximum number of suggestions.
MAX_SUGGESTIONS = 3
#: Maximum number of classes with skipped objects that are evaluated, those with most objects first: each requires
#: several posteriors.
MAX_SKIPPED_CLASSES = 6
#: Maximum number of truncated objects that are evaluated, those first whose class determines the scale best.
MAX_TRUNCATED_OBJECTS = 6
#: Log width of the interval without evidence: sizes within a factor of 50 (`posterior.log_scale_grid`).
UNKNOWN_LOG_WIDTH = log_scale_grid.WRONG_EVIDENCE_WIDTH_LOG

#: Interval of the scale after a measurement if the scale is the argument, in metres per unit.
_IntervalAt = Callable[[float], tuple[float, float]]
#: A possible measurement: text, object, option and interval.
_Measurement = tuple[str, str | None, str | None, _IntervalAt]


def suggest_measurements(
    evidence: EvidenceSet, tree: Tree, estimate: Posterior | None, level: float
) -> tuple[Help, ...]:
    """Return the measurements that would narrow the interval most, best first.

    Parameters
    ----------
    evidence : EvidenceSet
    tree : Tree
        Release for the classes that have no object yet.
    estimate : Posterior or None
        Posterior of the evidence; None without evidence.
    level : float
        Mass of the interval.
    """
    width, scales = UNKNOWN_LOG_WIDTH * level, [1.0]
    if estimate is not None:
        width = math.log(estimate.interval[1] / estimate.interval[0])
        mass = np.cumsum(estimate.curve.density)
        quantiles = np.interp(SUPPOSED_QUANTILES, mass / mass[-1], estimate.curve.log_scale)
        scales = [math.exp(u) for u in quantiles.tolist()]

    def interval_with(item: ObjectEvidence, index: int | None = None) -> tuple[float, float]:
        """Return the interval with one more object, or with this one instead of object `index`."""
        if estimate is None:
            return posterior([item], evidence.gaussians, level).interval
        others = [
            other
            for number, other in enumerate(evidence.objects)
            if number != index and other.prior.node_id == item.prior.node_id
        ]
        return estimate.with_class([*others, item])

    measurements = [
        *_complete_sides(evidence, interval_with),
        *_known_lengths(evidence, estimate, level),
        *_more_masks(evidence, tree, interval_with),
    ]
    rated = []
    for text, name, option, interval_at in measurements:
        intervals = [interval_at(scale) for scale in scales]
        new_width = sum(math.log(high / low) for low, high in intervals) / len(scales)
        rated.append(Help(text, name, round(1 - new_width / width, 2), option))
    useful = sorted((item for item in rated if item.narrows_by >= MIN_NARROWING), key=lambda item: -item.narrows_by)
    return tuple(useful[:MAX_SUGGESTIONS])


def _complete_sides(evidence: EvidenceSet, interval_with: Callable[..., tuple[float, float]]) -> Iterator[_Measurement]:
    """Yield the measurement of each truncated object without truncation."""
    truncated = [index for index, item in enumerate(evidence.objects) if visible_truncations(item.object).any()]
    truncated.sort(key=lambda index: shared_error(evidence.objects[index].prior).along_sd)
    for index in sorted(truncated[:MAX_TRUNCATED_OBJECTS]):
        item = evidence.objects[index]

        def interval_at(scale: float, index: int = index, item: ObjectEvidence = item) -> tuple[float, float]:
            return interval_with(_with_class_size(item, visible_truncations(item.object), scale), index)

        name = f"{item.object.category} {item.object.id}"
        yield f"two more images of the {name} from the side that is cut", name, None, interval_at


def _known_lengths(evidence: EvidenceSet, estimate: Posterior | None, level: float) -> Iterator[_Measurement]:
    """Yield the most accurate measurements with a tape: the height of an object, and the distance of two objects.

    An object that is probably an outlier is not suggested: its mask or its points may be those of another object.
    """
    candidates: list[tuple[float, str, str, str | None]] = []
    doubtful = set() if estimate is None else set(np.flatnonzero(estimate.weight < MIN_INLIER_PROBABILITY).tolist())
    objects = [row.object for number, row in enumerate(evidence.objects) if number not in doubtful]
    standing = [item for item in objects if item.vertical_known and not item.truncated[2]]
    if known := [item for item in standing if np.isfinite(item.sigma[2])]:
        best = min(known, key=lambda item: float(item.sigma[2]))
        name = f"{best.category} {best.id}"
        option = None if best.box is None else f"--known-length {shlex.quote(name)} height METRES"
        candidates.append((float(best.sigma[2]), f"the true height of the {name} as a known length", name, option))
    outliers = {evidence.indices[number] for number in doubtful}
    located = [item for index, item in enumerate(evidence.measured) if item.box is not None and index not in outliers]
    if (pair := _closest_known_pair([item for item in located if not item.truncated.any()])) is not None:
        error, item, other = pair
        name, other_name = (f"{one.category} {one.id}" for one in (item, other))
        option = f"--known-length {shlex.quote(name)} {shlex.quote(other_name)} METRES"
        text = f"the distance between the middles of the {name} and the {other_name}"
        candidates.append((error, text, name, option))
    for error, text, name, option in candidates:

        def interval_at(scale: float, sd: float = math.hypot(error, TAPE_SD_LOG)) -> tuple[float, float]:
            if estimate is None:
                return posterior((), np.array([[math.log(scale), sd, 0.0]]), level).interval
            return estimate.with_length(scale, sd)

        yield text, name, option, interval_at


def _closest_known_pair(objects: Sequence[MeasuredObject]) -> tuple[float, MeasuredObject, MeasuredObject] | None:
    """Return the pair of complete objects whose distance has the smallest relative error (`middle_distance`)."""
    centres = np.array([item.box.centre for item in objects if item.box is not None]).reshape(-1, 3)
    errors = [item.extents / 2 * np.hypot(item.sigma, MIDDLE_ERROR) for item in objects]
    variance = np.square(errors).reshape(-1, 3).sum(axis=1) / 3
    best = (math.inf, 0, 0)
    for index in range(len(objects) - 1):
        distance = np.linalg.norm(centres[index + 1 :] - centres[index], axis=1)
        with np.errstate(divide="ignore"):
            relative = np.sqrt(variance[index] + variance[index + 1 :]) / distance
        other = int(np.nan_to_num(relative, nan=np.inf).argmin())
        best = min(best, (float(relative[other]), index, index + 1 + other))
    return (best[0], objects[best[1]], objects[best[2]]) if math.isfinite(best[0]) else None


def _more_masks(
    evidence: EvidenceSet, tree: Tree, interval_with: Callable[..., tuple[float, float]]
) -> Iterator[_Measurement]:
    """Yield the measurement of one more object, of typical size, of each class with skipped or without any objects."""
    candidates: list[tuple[str, str | None, CategoryMatch]] = []
    skipped: dict[str, list[MeasuredObject]] = {}
    used = set(evidence.indices)
    for index, item in enumerate(evidence.measured):
        if index not in used and evidence.matches[item.category].prior is not None:
            skipped.setdefault(item.category, []).append(item)
    for category, members in sorted(skipped.items(), key=lambda pair: -len(pair[1]))[:MAX_SKIPPED_CLASSES]:
        count = "" if len(members) == 1 else f"one of the {len(members)} objects "
        text = f"masks of {count}{category!r} that could not be measured, in more images"
        candidates.append((text, f"{members[0].category} {members[0].id}", evidence.matches[category]))
    present = {item.prior.node_id for item in evidence.objects}
    for name, match in resolve_categories(tree, set(SUGGESTED_CATEGORIES)).items():
        if match.prior is not None and match.prior.node_id not in present:
            candidates.append((f"masks of a {name}, if there is one", None, match))
    has_images = any(item.views for item in evidence.measured)  # unlike objects that another program measured
    for text, object_name, match in candidates:
        assert match.prior is not None  # checked above
        assert match.node is not None
        measured = MeasuredObject("supposed", match.node.node_id, np.full(3, np.nan), np.full(3, MEASURED_SD_LOG))
        supposed = ObjectEvidence(measured, match.prior, match.node.pose)

        def interval_at(scale: float, supposed: ObjectEvidence = supposed) -> tuple[float, float]:
            return interval_with(_with_class_size(supposed, np.ones(3, dtype=bool), scale))

        yield text, object_name, "--draw" if has_images else None, interval_at


def _with_class_size(item: ObjectEvidence, sides: BoolArray, scale: float) -> ObjectEvidence:
    """Return the object with the sides (3,) bool replaced by accurate ones of the size of its class at a scale."""
    typical: FloatArray = np.full(3, np.nan)
    typical[prior_axes(item.prior)] = np.exp(item.prior.weights @ item.prior.means) / 1000 / scale
    if not is_sorted(item.prior) and typical[0] < typical[1]:
        typical[:2] = typical[1::-1]
    measured = replace(
        item.object,
        extents=np.where(sides, typical, item.object.extents),
        sigma=np.where(sides, MEASURED_SD_LOG, item.object.sigma),
        vertical_known=item.object.vertical_known and not (is_sorted(item.prior) and sides.all()),
        truncated=item.object.truncated & ~sides,
        covariance=None,  # the common errors belong to the replaced extents
    )
    return replace(item, object=measured)
