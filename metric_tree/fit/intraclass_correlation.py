"""Sameness: the share of a class's variance that the objects of one room have in common, from rooms that are known.

One-way random effects on ln size, ln x_ri = mu + a_r + e_ri over rooms r, sameness t = Var(a) / (Var(a) + Var(e)). With
the mean squares between and within rooms and n_0 the effective objects of a room (Searle, Casella and McCulloch 1992),

    t = (MSB - MSW) / (MSB + (n_0 - 1) MSW)
    Var(t) = 2 (N - 1) (1 - t)^2 (1 + (n_0 - 1) t)^2 / (n_0^2 (N - k) (k - 1))

for N objects in k rooms (Swiger and others 1964). Classes are shrunk towards each other by how much they differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_base.statistics import robust_sigma

#: Rooms with two objects or more below which a class says nothing of its own.
LEAST_ROOMS = 8

#: Robust deviations at which a size is cut: a box that swallowed a wall is no evidence of variety.
CLIP_SIGMAS = 3.0

#: Where no class is known: the mean and spread over the classes of ScanNet's rooms, rounded.
DEFAULT_MEAN, DEFAULT_SD = 0.45, 0.2


@dataclass(frozen=True, slots=True)
class Sameness:
    """A share from 0 to 1 and its standard deviation."""

    share: float
    sd: float


def class_sameness(x: FloatArray, source: NDArray[np.str_], scene: NDArray[np.str_]) -> Sameness | None:
    """The sameness of one class, unshrunk; None of too few rooms.

    Parameters
    ----------
    x : (n, d) ln size, NaN where unstated; source, scene : (n,) names, a scene empty where unknown. Only the source of
        most objects in known rooms counts: sets that measured the same rooms hold the same objects twice.
    """
    known = scene != ""
    if not known.any():
        return None
    names, counts = np.unique(source[known], return_counts=True)
    chosen = known & (source == names[np.argmax(counts)])
    parts = [part for column in x.T if (part := _of_axis(column[chosen], scene[chosen])) is not None]
    if not parts:
        return None
    precision = np.array([1 / part.sd**2 for part in parts])
    share = float(precision @ [part.share for part in parts] / precision.sum())
    return Sameness(share, float(np.sqrt(1 / precision.max())))  # the axes of one object are no independent witnesses


def shrunk_sameness(classes: Mapping[str, Sameness]) -> tuple[dict[str, Sameness], Sameness]:
    """The classes shrunk to their common mean (DerSimonian and Laird), and what is believed of any other class."""
    if len(classes) < 3:
        return {}, Sameness(DEFAULT_MEAN, DEFAULT_SD)
    share = np.array([one.share for one in classes.values()])
    variance = np.array([one.sd**2 for one in classes.values()])
    weight = 1 / variance
    mean = weight @ share / weight.sum()
    excess = weight @ (share - mean) ** 2 - (len(share) - 1)
    between = max(float(excess / (weight.sum() - (weight**2).sum() / weight.sum())), 0.05**2)
    weight = 1 / (variance + between)
    mean = float(weight @ share / weight.sum())
    shrunk = {
        name: Sameness(
            float(np.clip((one.share / one.sd**2 + mean / between) / (1 / one.sd**2 + 1 / between), 0.0, 1.0)),
            float(np.sqrt(1 / (1 / one.sd**2 + 1 / between))),
        )
        for name, one in classes.items()
    }
    return shrunk, Sameness(mean, float(np.sqrt(between + 1 / weight.sum())))


def _of_axis(x: FloatArray, scene: NDArray[np.str_]) -> Sameness | None:
    """The sameness on one axis: x (n,) ln size, NaN where unstated, scene (n,) names; None of too few rooms."""
    known = ~np.isnan(x)
    x, scene = x[known], scene[known]
    if len(x) == 0:
        return None
    centre, reach = np.median(x), CLIP_SIGMAS * max(robust_sigma(x), 0.02)
    x = np.clip(x, centre - reach, centre + reach)
    _, code, counts = np.unique(scene, return_inverse=True, return_counts=True)
    n, k = len(x), len(counts)
    if (counts >= 2).sum() < LEAST_ROOMS:
        return None
    means = np.bincount(code, x) / counts
    between = float(counts @ (means - x.mean()) ** 2) / (k - 1)
    within = float(((x - means[code]) ** 2).sum()) / (n - k)
    per_room = (n - (counts**2).sum() / n) / (k - 1)
    if between + within <= 0:
        return None
    share = float(np.clip((between - within) / (between + (per_room - 1) * within), 0.0, 0.99))
    variance = 2 * (n - 1) * (1 - share) ** 2 * (1 + (per_room - 1) * share) ** 2 / (per_room**2 * (n - k) * (k - 1))
    return Sameness(share, float(np.sqrt(max(variance, 1e-4))))
