"""objathor: the height in cm of an annotated asset from its category and proportions, with the model's as evidence.

A vision-language model states `category` and `height` in cm (objathor/annotation/gpt_from_views.py), and the conversion
scales the asset to this height. Replace the height before the conversion:

    annotation = metric_annotation(annotation, trimesh.load(glb_path).extents)

The y axis is vertical, as in the GLB files of Objaverse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import metric_tree

#: Standard deviation of the logarithm of a height by a language model.
SD_LOG = 0.3


def metric_annotation(annotation: Mapping[str, Any], extents: Sequence[float]) -> dict[str, Any]:
    """Return the annotation with `height` in cm, `height_range` (90 %), `height_probability` and the reason.

    Parameters
    ----------
    annotation : mapping
        `category` and, unless the model stated none, `height` in cm.
    extents : sequence of three float
        Extents of the mesh along x, y, z, in any unit.
    """
    stated_m, unit_cm = float(annotation.get("height") or 0) / 100, 100 * float(extents[1])
    evidence = [(stated_m / extents[1], SD_LOG)] if stated_m > 0 else []
    try:
        scale = metric_tree.scale_for(annotation["category"], list(extents), evidence=evidence, up="y")
    except metric_tree.UnknownName as error:  # the height of the language model stays
        return {**annotation, "height_reason": str(error)}
    return {
        **annotation,
        "height": round(scale.median * unit_cm, 1),
        "height_range": (round(scale.low * unit_cm, 1), round(scale.high * unit_cm, 1)),
        "height_probability": scale.level,
        "height_reason": scale.reason,
    }
