"""Objaverse: the factor to metres of objects whose files have any unit, from their LVIS categories and extents.

    categories = objaverse.load_lvis_annotations()                 # category -> uids
    files = objaverse.load_objects(uids)                           # uid -> GLB
    extents = {uid: trimesh.load(file).extents for uid, file in files.items()}
    for scale in object_scales(categories, extents): ...

GLB files are in metres by their specification with y up, and those of Objaverse mostly are not in metres.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import metric_tree


@dataclass(frozen=True, slots=True)
class ObjectFactor:
    """The factor from the file to metres; `verdict` on the file as metres with its probability."""

    uid: str
    category: str
    factor: float
    low: float  #: Ends of the interval of the factor with 90 %.
    high: float
    verdict: str
    probability: float
    reason: str


def object_scales(
    categories: Mapping[str, Sequence[str]],
    extents: Mapping[str, Sequence[float]],
    estimates: Mapping[str, tuple[float, float]] | None = None,
) -> Iterator[ObjectFactor]:
    """Yield the factor of each object with extents whose category is known.

    Parameters
    ----------
    categories : mapping of str to sequence of str
        Uids by category, as `objaverse.load_lvis_annotations` returns them.
    extents : mapping of str to sequence of three float
        Extents along x, y, z by uid.
    estimates : mapping of str to (factor, sd_log), optional
        Existing estimates by uid, with the standard deviation of the logarithm: one more evidence.
    """
    for category, uids in categories.items():
        for uid in (uid for uid in uids if uid in extents):
            evidence = [estimates[uid]] if estimates and uid in estimates else []
            try:
                scale = metric_tree.scale_for(category, list(extents[uid]), evidence=evidence, up="y")
            except metric_tree.UnknownName:
                break  # of the other objects of the category, too
            low, high = scale.low, scale.high
            yield ObjectFactor(uid, category, scale.factor, low, high, scale.verdict, scale.probability, scale.reason)
