"""What would help most: the expected narrowing of the interval by one more measurement, computed for each.

What a measurement would give is not known, so each is supposed at a few equally likely scales of the present posterior:
the object then has the size that its class has there, the known length says that scale, and the posterior is
computed again. What is stated is the mean part of the interval's log width that is gone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimator.posterior import log_scale_grid
from estimator.posterior.axis_assignments import is_sorted, prior_axes
from estimator.posterior.object_likelihood import ObjectEvidence
from estimator.posterior.posterior import Posterior, posterior
from estimator.records.objects import MeasuredObject
from estimator.records.result import Help
from estimator.results.object_priors import LabelMeaning, cut_sides, meanings
from metric_base.arrays import BoolArray, FloatArray
from metric_tree.tree import Tree

#: Quantiles of the posterior at which a measurement is supposed: three parts of equal mass.
SUPPOSED_AT = (1 / 6, 1 / 2, 5 / 6)

#: Standard deviation of ln size of an object that is measured well, and of a length that a person measures.
MEASURED_SD_LOG, TAPE_SD_LOG = 0.05, 0.01

#: Classes that are often near, in rooms or in streets, of known sizes: one of them that has no mask yet may be there.
OFTEN_NEAR = ("chair", "table", "door", "person")

#: Narrowing under this is not worth a person's time; more than so many pieces of advice are not read.
LEAST_NARROWING, MOST_HELPS = 0.05, 3

#: Classes whose skipped objects are tried, those with most objects first: each takes some posteriors.
MOST_SKIPPED_CLASSES = 6

#: The log width of the interval where nothing is known: sizes over a factor of 50 (`posterior.grid`).
NOTHING_KNOWN_LOG = log_scale_grid.WRONG_EVIDENCE_WIDTH_LOG

#: A supposed measurement: the posterior's evidence and lines (k, 3) if the scale were so many metres per unit.
_Supposed = Callable[[float], Posterior]


def helps(
    objects: Sequence[MeasuredObject],
    stated: Mapping[int, ObjectEvidence],
    by_name: Mapping[str, LabelMeaning],
    tree: Tree,
    lines: FloatArray,
    estimate: Posterior | None,
    level: float,
) -> tuple[Help, ...]:
    """The measurements that would narrow the interval most, best first; lines : (k, 3) the other evidence.

    stated : the objects that spoke, by their place among `objects`; estimate : None where nothing spoke.
    """
    width = NOTHING_KNOWN_LOG * level if estimate is None else math.log(estimate.interval[1] / estimate.interval[0])
    scales = [1.0] if estimate is None else _quantiles(estimate)

    def again(evidence: Sequence[ObjectEvidence], more: FloatArray = lines) -> Posterior:
        return posterior(evidence, more, level)

    offers = [
        *_whole_sides(stated, again),
        *_known_length(stated, lines, again),
        *_masks(objects, stated, by_name, again),
        *_other_classes(stated, tree, again),
    ]
    rated = [
        Help(what, name, round(1 - sum(_log_width(posterior_at(scale)) for scale in scales) / len(scales) / width, 2))
        for what, name, posterior_at in offers
    ]
    worth = sorted((one for one in rated if one.narrows_by >= LEAST_NARROWING), key=lambda one: -one.narrows_by)
    return tuple(worth[:MOST_HELPS])


def _whole_sides(
    stated: Mapping[int, ObjectEvidence], again: Callable[..., Posterior]
) -> Iterator[tuple[str, str | None, _Supposed]]:
    """Truncated objects, measured whole."""
    for place, item in stated.items():
        cut = cut_sides(item.object)
        if not cut.any():
            continue

        def posterior_at(
            scale: float, place: int = place, item: ObjectEvidence = item, cut: BoolArray = cut
        ) -> Posterior:
            others = [one for row, one in stated.items() if row != place]
            return again([*others, _whole(item, cut, scale)])

        name = _name(item.object)
        yield f"two more pictures of the {name} from the side that is cut", name, posterior_at


def _known_length(
    stated: Mapping[int, ObjectEvidence], lines: FloatArray, again: Callable[..., Posterior]
) -> Iterator[tuple[str, str | None, _Supposed]]:
    """The height of the object that is measured best, with a tape; lines : (k, 3) as `posterior` takes them."""
    known = [
        item.object
        for item in stated.values()
        if item.object.vertical_known and not item.object.truncated[2] and np.isfinite(item.object.sigma[2])
    ]
    if known:
        best = min(known, key=lambda one: float(one.sigma[2]))
        sd = math.hypot(float(best.sigma[2]), TAPE_SD_LOG)
        evidence = list(stated.values())
        yield (
            f"the true height of the {_name(best)} as a known length",
            _name(best),
            lambda scale: again(evidence, np.vstack([lines, [math.log(scale), sd, 0.0]])),
        )


def _masks(
    objects: Sequence[MeasuredObject],
    stated: Mapping[int, ObjectEvidence],
    by_name: Mapping[str, LabelMeaning],
    again: Callable[..., Posterior],
) -> Iterator[tuple[str, str | None, _Supposed]]:
    """Objects that could not be measured, by class: one of them as if it had been."""
    skipped: dict[str, list[MeasuredObject]] = {}
    for place, item in enumerate(objects):
        if place not in stated and by_name[item.category].prior is not None:
            skipped.setdefault(item.category, []).append(item)
    for category, members in sorted(skipped.items(), key=lambda pair: -len(pair[1]))[:MOST_SKIPPED_CLASSES]:
        count = "" if len(members) == 1 else f"one of the {len(members)} objects "
        what = f"masks of {count}{category!r} that could not be measured, in more pictures"
        yield what, _name(members[0]), _with_another(by_name[category], stated, again)


def _other_classes(
    stated: Mapping[int, ObjectEvidence], tree: Tree, again: Callable[..., Posterior]
) -> Iterator[tuple[str, str | None, _Supposed]]:
    """A class that has no object yet."""
    there = {item.prior.node_id for item in stated.values()}
    for name, meaning in meanings(tree, set(OFTEN_NEAR)).items():
        if meaning.prior is not None and meaning.prior.node_id not in there:
            yield f"masks of a {name}, if there is one", None, _with_another(meaning, stated, again)


def _with_another(
    meaning: LabelMeaning, stated: Mapping[int, ObjectEvidence], again: Callable[..., Posterior]
) -> _Supposed:
    """One more object of a class, as large as its class is."""
    assert meaning.prior is not None  # the callers chose such
    assert meaning.node is not None
    pose = meaning.node.pose
    plain = MeasuredObject("supposed", meaning.node.node_id, np.full(3, np.nan), np.full(3, MEASURED_SD_LOG))
    item = ObjectEvidence(plain, meaning.prior, pose)
    return lambda scale: again([*stated.values(), _whole(item, np.ones(3, dtype=bool), scale)])


def _whole(item: ObjectEvidence, sides: BoolArray, scale: float) -> ObjectEvidence:
    """The object with these sides (3,) as large as its class at a scale, measured well."""
    usual = np.full(3, np.nan)
    usual[prior_axes(item.prior)] = np.exp(item.prior.weights @ item.prior.means) / 1000 / scale
    if not is_sorted(item.prior) and usual[0] < usual[1]:
        usual[:2] = usual[1::-1]
    extents = np.where(sides, usual, item.object.extents)
    sigma = np.where(sides, MEASURED_SD_LOG, item.object.sigma)
    vertical = item.object.vertical_known and not (is_sorted(item.prior) and sides.all())
    whole = replace(item.object, extents=extents, sigma=sigma, vertical_known=vertical)
    # errors that went together were those of the extents that are replaced here
    return replace(item, object=replace(whole, truncated=item.object.truncated & ~sides, covariance=None))


def _quantiles(estimate: Posterior) -> list[float]:
    """Metres per unit at `SUPPOSED_AT` of the part of the posterior that lies on its grid."""
    mass = np.cumsum(estimate.curve.density)
    return [math.exp(u) for u in np.interp(SUPPOSED_AT, mass / mass[-1], estimate.curve.log_scale).tolist()]


def _log_width(estimate: Posterior) -> float:
    return math.log(estimate.interval[1] / estimate.interval[0])


def _name(item: MeasuredObject) -> str:
    return f"{item.category} {item.id}"
