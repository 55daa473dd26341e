"""Explain the extents of an object: hypotheses about its scale, with their posterior probabilities.

A hypothesis is an orientation (as in the file, or rotated) and a kind of scale: right, a wrong unit, an arbitrary
scale (including meshes that are normalised to a unit box), a miniature, one stretched side, or none of these. The same
size model gives the density of the extents for each hypothesis, so that proportions and size affect all hypotheses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from metric_base.arrays import FloatArray
from models3d.asset import AXES, AssetBody, Up
from models3d.size_check.size_model import SizeModel

#: Kinds of scale; `unlike` is unexplained.
ScaleKind = Literal["right", "unit", "arbitrary", "miniature", "stretched", "unlike"]

#: Prior probability of each kind. Most files are right; of the errors, wrong units and normalised meshes are reported
#: most often (docs/explanation/model-sizes.md lists the reports).
CHANCE: Mapping[ScaleKind, float] = {
    "right": 0.70,
    "unit": 0.18,
    "arbitrary": 0.06,
    "miniature": 0.01,
    "stretched": 0.02,
    "unlike": 0.03,
}
#: Prior probability of a miniature if the texts of the file contain toy, miniature, figurine or a ratio.
NAMED_MINIATURE = 0.5
#: Prior probability of a miniature in categories of which toys are common: vehicles and animals.
TOY_CHANCE = 0.06
#: Factors that correct a wrong unit, with their probabilities: millimetres or centimetres read as metres and the
#: reverse, inches, feet, and conversions that were applied twice.
UNIT_FACTORS: Mapping[float, float] = {
    0.001: 0.20, 0.01: 0.25, 0.1: 0.07, 10.0: 0.07, 100.0: 0.12, 1000.0: 0.09,
    0.0254: 0.05, 25.4: 0.03, 2.54: 0.02, 1 / 2.54: 0.02, 39.37: 0.02, 0.3048: 0.03, 1 / 0.3048: 0.03,
}  # fmt: skip
#: Ratios of the true size to the size of a miniature, from garden railways to somewhat beyond 1:87.
MINIATURE_RATIOS = tuple(float(ratio) for ratio in np.geomspace(6, 110, 22))
#: Maximum factor of an arbitrary scale, in both directions; its logarithm is uniformly distributed.
ARBITRARY_RANGE = 1e4
#: Fraction of the arbitrary scales that are normalised to a box.
NORMALISED_FRACTION = 0.6
#: Longest sides of normalised boxes, in metres.
NORMALISED_M = (1.0, 2.0, 0.5, 100.0)
#: Standard deviation of the logarithm of the longest side of a normalised box.
NORMALISED_SD = 0.001
#: Probability that a normalised mesh is centred on the origin.
CENTRED_NORMALISED = 0.8
#: Probability that another mesh is centred on the origin.
CENTRED_OTHER = 0.2
#: Fraction of the models with the right scale whose longest side is a round number.
ROUND_FRACTION = 0.2
#: Step between round numbers, relative to the power of ten below the longest side.
ROUND_STEP = 0.1
#: Prior probability that an object is rotated although the file states its up axis.
ROTATED_CHANCE = 0.04
#: Prior probability of each up axis if the file does not state it.
UP_UNSTATED: Mapping[Up, float] = {"x": 0.04, "y": 0.5, "z": 0.46}
#: Maximum factor of a stretched side, in both directions; its logarithm is uniformly distributed.
STRETCH_RANGE = 10.0
#: Range of each side of an unexplained object, as a factor; its logarithm is uniformly distributed.
UNLIKE_RANGE = 1e4
#: Minimum side in metres, so that the logarithm of a plane is defined.
MIN_SIDE_M = 1e-6


@dataclass(frozen=True, slots=True)
class ScaleHypothesis:
    """One explanation of the extents of an object."""

    kind: ScaleKind
    #: Factor that corrects the size; None if the kind does not determine it.
    factor: float | None
    #: Axis that points up.
    up: Up
    #: True if `up` differs from the up axis of the file.
    is_rotated: bool
    #: Posterior probability.
    probability: float
    #: The stretched side: 0 length, 1 width, 2 height.
    axis: int | None = None


def hypotheses(
    body: AssetBody, up: Up | None, model: SizeModel, miniature: float = CHANCE["miniature"]
) -> tuple[ScaleHypothesis, ...]:
    """Compute the posterior probabilities of all explanations of the extents of an object.

    Parameters
    ----------
    body : AssetBody
    up : {"x", "y", "z"} or None
        Up axis of the file, if it is known.
    model : SizeModel
        Extents of true-sized models of the category.
    miniature : float
        Prior probability of a miniature.

    Returns
    -------
    tuple of ScaleHypothesis
        Sorted by probability, the highest first; the probabilities sum to 1.
    """
    if model.is_sorted:  # the model has no vertical axis
        up_chance: dict[Up, float] = {up or "y": 1.0}
    elif up is None:
        up_chance = dict(UP_UNSTATED)
    else:
        up_chance = {up: 1 - ROTATED_CHANCE, **{axis: ROTATED_CHANCE / 2 for axis in AXES if axis != up}}
    x = np.stack([ordered_sizes(body.extents_m, axis, model.is_sorted) for axis in up_chance])  # (o, 3) ln mm
    chance = {**CHANCE, "miniature": miniature}
    rows: list[tuple[ScaleKind, float | None, int | None, FloatArray]] = []
    # The true scale: round numbers are common.
    longest_m = max(float(body.extents_m.max()), MIN_SIDE_M)
    step = ROUND_STEP * 10 ** np.floor(np.log10(longest_m))
    distance = abs(longest_m / step - round(longest_m / step)) * step / longest_m
    close_fraction = 2 * NORMALISED_SD * longest_m / step  # fraction of all sizes that are as close to a round one
    of_round = ROUND_FRACTION / close_fraction if distance < NORMALISED_SD else 0.0
    log_round = float(np.log((1 - ROUND_FRACTION) + of_round))
    rows.append(("right", 1.0, None, np.log(chance["right"]) + model.log_density(x) + log_round))
    for factor, fraction in UNIT_FACTORS.items():
        rows.append(("unit", factor, None, np.log(chance["unit"] * fraction) + model.log_density(x + np.log(factor))))
    # An arbitrary scale: the density of the proportions times the density of the size. Normalised meshes are
    # concentrated at a few sizes and are usually centred on the origin.
    centred_normalised = CENTRED_NORMALISED if body.is_centred else 1 - CENTRED_NORMALISED
    centred_other = CENTRED_OTHER if body.is_centred else 1 - CENTRED_OTHER
    any_size = (1 - NORMALISED_FRACTION) * centred_other / (2 * np.log(ARBITRARY_RANGE))
    z = (np.log(longest_m) - np.log(NORMALISED_M)) / NORMALISED_SD
    at_unit = float(np.mean(np.exp(-(z**2) / 2))) / (NORMALISED_SD * np.sqrt(2 * np.pi))
    size = any_size + NORMALISED_FRACTION * at_unit * centred_normalised
    log_arbitrary = model.log_evidence(x) + np.log(size / centred_other)
    rows.append(("arbitrary", None, None, np.log(chance["arbitrary"]) + log_arbitrary))
    each = np.log(chance["miniature"] / len(MINIATURE_RATIOS))
    rows += [("miniature", ratio, None, each + model.log_density(x + np.log(ratio))) for ratio in MINIATURE_RATIOS]
    for axis in model.axes if len(model.axes) > 1 else ():
        others = model.without(axis).log_density(x) - np.log(2 * np.log(STRETCH_RANGE))
        rows.append(("stretched", None, axis, np.log(chance["stretched"] / len(model.axes)) + others))
    unlike = -len(model.axes) * np.log(np.log(UNLIKE_RANGE))
    rows.append(("unlike", None, None, np.full(len(x), np.log(chance["unlike"]) + unlike)))
    table = np.stack([row[3] for row in rows]) + np.log(list(up_chance.values()))  # (h, o)
    weights = np.exp(table - table.max())
    weights /= weights.sum()
    explanations = [
        ScaleHypothesis(kind, factor, axis_up, up is not None and axis_up != up, float(weights[h, o]), axis)
        for h, (kind, factor, axis, _) in enumerate(rows)
        for o, axis_up in enumerate(up_chance)
    ]
    return tuple(sorted(explanations, key=lambda hypothesis: -hypothesis.probability))


def ordered_sizes(extents_m: FloatArray, up: Up, is_sorted: bool) -> FloatArray:
    """Return ln mm (3,) of length, width and height with this up axis, or of the extents, the longest first."""
    sizes = np.log(np.maximum(extents_m, MIN_SIDE_M) * 1000)
    if is_sorted:
        return np.sort(sizes)[::-1]
    vertical = AXES.index(up)
    sides = np.sort(np.delete(sizes, vertical))[::-1]
    return np.array([sides[0], sides[1], sizes[vertical]])
