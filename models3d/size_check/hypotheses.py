"""What may be wrong with a stated size: the hypotheses, their prior chances, and their posterior for one object.

A hypothesis is an orientation (as stated, or turned) and a kind of scale: right, a slip of the unit by a factor, an
arbitrary scale (a mesh normalised to a unit box among them), a miniature, one stretched side, or none of these. Each
gives a density of the stated extents from the same size model, so that proportions and size count in all of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from metric_base.arrays import FloatArray
from models3d.asset import AXES, AssetBody, Up
from models3d.size_check.size_model import SizeModel

ScaleKind = Literal["right", "unit", "arbitrary", "miniature", "stretched", "unlike"]

#: Chance of each kind before the extents are seen. A file that is as it should be is the common case; of the faults
#: those of units and of normalised meshes are reported most (docs/explanation/assets.md names the threads).
CHANCE: Mapping[ScaleKind, float] = {
    "right": 0.70,
    "unit": 0.18,
    "arbitrary": 0.06,
    "miniature": 0.01,
    "stretched": 0.02,
    "unlike": 0.03,
}
#: The same of a miniature where the file's own words say toy, miniature, figurine or a ratio.
NAMED_MINIATURE = 0.5
#: What the stated size is to be multiplied by, with the share of all slips: millimetres or centimetres read as metres
#: and the reverse, inches, feet, and a metre taken for one of these twice.
UNIT_FACTORS: Mapping[float, float] = {
    0.001: 0.20, 0.01: 0.25, 0.1: 0.07, 10.0: 0.07, 100.0: 0.12, 1000.0: 0.09,
    0.0254: 0.05, 25.4: 0.03, 2.54: 0.02, 1 / 2.54: 0.02, 39.37: 0.02, 0.3048: 0.03, 1 / 0.3048: 0.03,
}  # fmt: skip
#: Of kinds of which toys are common: vehicles and animals.
TOY_CHANCE = 0.06
#: Models and toys are so many times smaller than what they show, from garden railways to 1:87 and a little beyond.
MINIATURE_RATIOS = tuple(float(ratio) for ratio in np.geomspace(6, 110, 22))
#: An arbitrary scale is any within this factor either way, all alike in the logarithm.
ARBITRARY_RANGE = 1e4
#: Share of the arbitrary scales that normalise a box, and to what its longest side then is.
NORMALISED_SHARE, NORMALISED_M, NORMALISED_SD = 0.6, (1.0, 2.0, 0.5, 100.0), 0.001
#: A normalised mesh is centred on the origin this often, any other this often.
CENTRED_NORMALISED, CENTRED_OTHER = 0.8, 0.2
#: Share of true-sized models drawn to a round number, and the round numbers' distance at 1 m.
ROUND_SHARE, ROUND_STEP = 0.2, 0.1
#: Chance that an object is turned where the file states its up axis, and of each axis where it does not.
TURNED = 0.04
UP_UNSTATED: Mapping[Up, float] = {"x": 0.04, "y": 0.5, "z": 0.46}
#: A stretched side is longer or shorter by a factor up to this.
STRETCH_RANGE = 10.0
#: What is unlike anything known has sides anywhere in this range, all alike in the logarithm.
UNLIKE_RANGE = 1e4
#: A side of no extent counts as this many metres, so that a plane has a logarithm.
LEAST_M = 1e-6


@dataclass(frozen=True, slots=True)
class ScaleHypothesis:
    """One explanation of the stated extents, with its posterior probability.

    factor : what the stated size is to be multiplied by, None where the kind says nothing; up : the axis that points
    up; turned : whether that is not the stated one; axis : the stretched side, 0 length, 1 width, 2 height.
    """

    what: ScaleKind
    factor: float | None
    up: Up
    turned: bool
    probability: float
    axis: int | None = None


def hypotheses(
    body: AssetBody, up: Up | None, model: SizeModel, miniature: float = CHANCE["miniature"]
) -> tuple[ScaleHypothesis, ...]:
    """All explanations of one body's extents, the likeliest first; their probabilities sum to 1.

    miniature : chance that it is one, before its extents are seen.
    """
    ups = _up_chances(up, model)
    x = np.stack([ordered_sizes(body.extents_m, axis, model.is_sorted) for axis in ups])  # (o, 3) ln mm
    chance = {**CHANCE, "miniature": miniature}
    rows: list[tuple[ScaleKind, float | None, int | None, FloatArray]] = []
    rows.append(("right", 1.0, None, np.log(chance["right"]) + model.log_density(x) + _log_round(body)))
    for factor, share in UNIT_FACTORS.items():
        rows.append(("unit", factor, None, np.log(chance["unit"] * share) + model.log_density(x + np.log(factor))))
    rows.append(("arbitrary", None, None, np.log(chance["arbitrary"]) + _log_arbitrary(body, model, x)))
    each = np.log(chance["miniature"] / len(MINIATURE_RATIOS))
    rows += [("miniature", ratio, None, each + model.log_density(x + np.log(ratio))) for ratio in MINIATURE_RATIOS]
    for axis in model.axes if len(model.axes) > 1 else ():
        others = model.without(axis).log_density(x) - np.log(2 * np.log(STRETCH_RANGE))
        rows.append(("stretched", None, axis, np.log(chance["stretched"] / len(model.axes)) + others))
    unlike = -len(model.axes) * np.log(np.log(UNLIKE_RANGE))
    rows.append(("unlike", None, None, np.full(len(x), np.log(chance["unlike"]) + unlike)))
    table = np.stack([row[3] for row in rows]) + np.log(list(ups.values()))  # (h, o)
    weights = np.exp(table - table.max())
    weights /= weights.sum()
    explanations = [
        ScaleHypothesis(what, factor, axis_up, up is not None and axis_up != up, float(weights[h, o]), axis)
        for h, (what, factor, axis, _) in enumerate(rows)
        for o, axis_up in enumerate(ups)
    ]
    return tuple(sorted(explanations, key=lambda one: -one.probability))


def _up_chances(up: Up | None, model: SizeModel) -> dict[Up, float]:
    """The axes that may point up with their chances; one where the size model does not know the vertical."""
    if model.is_sorted:
        return {up or "y": 1.0}
    if up is None:
        return dict(UP_UNSTATED)
    return {up: 1 - TURNED, **{axis: TURNED / 2 for axis in AXES if axis != up}}


def ordered_sizes(extents_m: FloatArray, up: Up, is_sorted: bool) -> FloatArray:
    """(3,) ln mm of length, width, height with this axis up, or of the extents, longest first."""
    sizes = np.log(np.maximum(extents_m, LEAST_M) * 1000)
    if is_sorted:
        return np.sort(sizes)[::-1]
    vertical = AXES.index(up)
    sides = np.sort(np.delete(sizes, vertical))[::-1]
    return np.array([sides[0], sides[1], sizes[vertical]])


def _log_arbitrary(body: AssetBody, model: SizeModel, x: FloatArray) -> FloatArray:
    """(o,) log density of x (o, 3) at an arbitrary scale: its proportions, and the chance of its size."""
    any_size = (1 - NORMALISED_SHARE) * _centre_chance(body, CENTRED_OTHER) / (2 * np.log(ARBITRARY_RANGE))
    longest = np.log(max(float(body.extents_m.max()), LEAST_M))
    z = (longest - np.log(NORMALISED_M)) / NORMALISED_SD
    at_unit = float(np.mean(np.exp(-(z**2) / 2))) / (NORMALISED_SD * np.sqrt(2 * np.pi))
    size = any_size + NORMALISED_SHARE * at_unit * _centre_chance(body, CENTRED_NORMALISED)
    return np.asarray(model.log_evidence(x) + np.log(size / _centre_chance(body, CENTRED_OTHER)))


def _centre_chance(body: AssetBody, chance: float) -> float:
    return chance if body.centred else 1 - chance


def _log_round(body: AssetBody) -> float:
    """What a round longest side adds: round numbers are common where the scale is right."""
    longest = max(float(body.extents_m.max()), LEAST_M)
    step = ROUND_STEP * 10 ** np.floor(np.log10(longest))
    off = abs(longest / step - round(longest / step)) * step / longest
    share_of_line = 2 * NORMALISED_SD * longest / step  # of all sizes, how many are as near to a round one
    is_round = off < NORMALISED_SD
    return float(np.log((1 - ROUND_SHARE) + (ROUND_SHARE / share_of_line if is_round else 0.0)))
