"""Sources of evidence for the scale other than objects, for `estimate_scale(..., evidence=...)`.

>>> from estimator.evidence import CameraHeight
>>> CameraHeight.of("1.5+-0.15")
CameraHeight(metres=1.5, sd=0.15)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from metric_base.lazy_names import lazy_names

if TYPE_CHECKING:
    from estimator.evidence.camera_height import CameraHeight as CameraHeight
    from estimator.evidence.depth_maps import MetricDepth as MetricDepth
    from estimator.evidence.gps import Gps as Gps
    from estimator.evidence.gps import VideoGps as VideoGps
    from estimator.evidence.imu import Imu as Imu
    from estimator.evidence.known_lengths import KnownLength as KnownLength
    from estimator.evidence.markers import Marker as Marker
    from estimator.evidence.rig_baseline import RigBaseline as RigBaseline
    from estimator.evidence.source import EvidenceSource as EvidenceSource

#: Module of each public name, imported on first use, so that `--objects` does not import SciPy.
__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "camera_height": ("CameraHeight",),
        "depth_maps": ("MetricDepth",),
        "gps": ("Gps", "VideoGps"),
        "imu": ("Imu",),
        "known_lengths": ("KnownLength",),
        "markers": ("Marker",),
        "rig_baseline": ("RigBaseline",),
        "source": ("EvidenceSource",),
    },
)
