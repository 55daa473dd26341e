"""How well the frames of a model determine its focal length."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator.reconstructions.pycolmap_library import pycolmap

__all__ = ["focal_deviation"]


def focal_deviation(model: Any) -> float | None:
    """Standard deviation of the focal length, as a share of it, if every observation were off by one pixel.

    model : a `pycolmap.Reconstruction`, whose bundle adjustment has converged.

    It is the square root of the focal length's entry in (J^T J)^-1, with the Jacobian J of all reprojection errors by
    poses, points and lens. None where the matrix cannot be inverted. A camera that moves without turning does not
    determine its focal length (Sturm 1999, "Critical motion sequences for the self-calibration of cameras"): scaling
    all depths by a factor and the focal length by the same gives the same pictures. The residuals of such a model are
    small, and only the deviation shows it. Of several cameras it is the median.
    """
    options = pycolmap.BundleAdjustmentOptions(refine_focal_length=True, refine_extra_params=True)
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    covariance = pycolmap.estimate_ba_covariance(pycolmap.BACovarianceOptions(), model, adjuster)
    if covariance is None:
        return None
    deviations = []
    for camera in model.cameras.values():
        of_lens = covariance.get_other_params_cov(camera.params)  # (p, p), the focal length first
        if of_lens is not None and of_lens[0, 0] >= 0:
            deviations.append(float(np.sqrt(of_lens[0, 0]) / camera.params[0]))
    return float(np.median(deviations)) if deviations and np.isfinite(deviations).all() else None
