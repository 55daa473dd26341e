"""EmbodiedGen: the height of a generated mesh from its category and proportions, with the language model's as evidence.

`URDFGenerator.__call__` (embodied_gen/validators/urdf_convertor.py) sets `real_height` to the middle of the range that
a language model states. Replace that line:

    asset_attrs = metric_height(asset_attrs, trimesh.load(mesh_path).extents)

The y axis is vertical, as in `generate_urdf`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import metric_tree

#: Minimum standard deviation of the logarithm of a height by a language model, whose ranges are often narrow.
MIN_SD_LOG = 0.2
#: Minimum ratio of the ends of a range, for ranges that begin at zero.
MIN_RANGE_RATIO = 0.1
#: Number of standard deviations from the centre of a range to its ends, which are treated as a 90 % interval.
Z = 1.645


def metric_height(attributes: Mapping[str, Any], extents: Sequence[float]) -> dict[str, Any]:
    """Return the attributes with `real_height` in metres, `height_range` (90 %) and the reason.

    Parameters
    ----------
    attributes : mapping
        `category`, `min_height` and `max_height` in metres, as `parse_response` returns them.
    extents : sequence of three float
        Extents of the mesh along x, y, z, in any unit.
    """
    ends, height = sorted(float(attributes[name]) for name in ("min_height", "max_height")), float(extents[1])
    low, high = max(ends[0], MIN_RANGE_RATIO * ends[1]), ends[1]
    evidence = []
    if high > 0:
        sd_log = max(math.log(high / low) / (2 * Z), MIN_SD_LOG)
        evidence = [(math.sqrt(low * high) / height, sd_log)]
    try:
        scale = metric_tree.scale_for(attributes["category"], list(extents), evidence=evidence, up="y")
    except metric_tree.UnknownName as error:  # the language model's estimate stays
        return {**attributes, "real_height": sum(ends) / 2, "reason": str(error)}
    found = {"real_height": round(scale.median * height, 4), "reason": scale.reason}
    return {**attributes, **found, "height_range": (round(scale.low * height, 4), round(scale.high * height, 4))}
