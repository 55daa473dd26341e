"""Sources of evidence for the scale other than objects, for `estimate_scale(..., evidence=...)`.

>>> from estimator.evidence import CameraHeight
>>> CameraHeight.of("1.5+-0.15")
CameraHeight(metres=1.5, sd=0.15)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from estimator.evidence.camera_height import CameraHeight
    from estimator.evidence.depth_maps import MetricDepth
    from estimator.evidence.gps import Gps, VideoGps
    from estimator.evidence.imu import Imu
    from estimator.evidence.known_lengths import KnownLength
    from estimator.evidence.markers import Marker
    from estimator.evidence.rig_baseline import RigBaseline
    from estimator.evidence.source import EvidenceSource

__all__ = [
    "CameraHeight",
    "EvidenceSource",
    "Gps",
    "Imu",
    "KnownLength",
    "Marker",
    "MetricDepth",
    "RigBaseline",
    "VideoGps",
]

#: Module of each public name, imported on first use, so that `--objects` does not import SciPy.
_MODULES = {
    "CameraHeight": "camera_height",
    "EvidenceSource": "source",
    "Gps": "gps",
    "Imu": "imu",
    "KnownLength": "known_lengths",
    "Marker": "markers",
    "MetricDepth": "depth_maps",
    "RigBaseline": "rig_baseline",
    "VideoGps": "gps",
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'estimator.evidence' has no attribute {name!r}")
    return getattr(import_module(f"estimator.evidence.{_MODULES[name]}"), name)
