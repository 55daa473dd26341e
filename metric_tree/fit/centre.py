"""Where a class lies and how far a scene's objects may lie from there, from what its sources state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.fit.disagreement import Disagreement
from metric_tree.fit.kinds import KindModel

__all__ = ["Centre", "class_centre", "shared_covariance"]

#: A class's own estimate of B counts as many sources as it has, less one; the model of all classes counts this many.
#: Chosen by leaving sources out (`benchmarks/metric_tree/priors.py --sources`).
MODEL_SOURCES = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Centre:
    """mean (d,) of ln size, NaN where no source states the axis; variance (d,) of that mean; effects (s, d).

    An effect is the best prediction of what the mean of a source is off by, its kind's bias included.
    """

    mean: FloatArray
    variance: FloatArray
    effects: FloatArray


def shared_covariance(one: Disagreement, model: KindModel, family: str) -> FloatArray:
    """B of one class, (d, d): its own estimate and that of the model, each by the sources it counts."""
    expected = model.between(one.within, family)
    return np.asarray((one.freedom * one.between + MODEL_SOURCES * expected) / (one.freedom + MODEL_SOURCES))


def class_centre(one: Disagreement, shared: FloatArray, model: KindModel, family: str) -> Centre:
    """The generalised least squares mean (d,) over the sources, axis by axis; `shared` is B (d, d), in log mm.

    With V_s = B + excess(kind)^2 + W / n_s and m_s less the bias of its kind: mean = sum m_s / V_s / sum 1 / V_s. The
    effect of a source is its bias plus (V_s - W / n_s) / V_s (m_s - mean).
    """
    bias = np.array([model.bias_of(kind, family) for kind in one.kinds])[:, None]  # (s, 1)
    excess = np.array([model.error_sd(kind) for kind in one.kinds])[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        noise = np.diagonal(one.within) / one.rows  # (s, d), infinite where unstated
        error = np.diagonal(shared) + excess**2
        weight = np.where(one.rows > 0, 1 / (error + noise), 0.0)
        mean = (weight * np.nan_to_num(one.means - bias)).sum(axis=0) / weight.sum(axis=0)
        effects = np.where(one.rows > 0, error / (error + noise) * (one.means - bias - mean), 0.0) + bias
        return Centre(mean, 1 / weight.sum(axis=0), np.nan_to_num(effects))
