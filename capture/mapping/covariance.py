"""Standard deviations of a model's focal length and of its camera steps, from the covariance of the adjustment."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator.reconstructions.pycolmap_library import pycolmap

#: Minimum length of a step relative to the extent of the path, to which its standard deviation is related: shorter
#: steps need not be known to a part of themselves.
MIN_STEP_RATIO = 0.02


def standard_deviations(model: Any) -> tuple[float | None, dict[str, float]]:
    """Return the standard deviations of the focal length and of the steps between consecutive frames.

    They are taken from (J^T J)^-1, with the Jacobian J of all reprojection errors by poses, points and camera
    parameters. A camera that moves without turning does not determine its focal length (Sturm 1999, "Critical motion
    sequences for the self-calibration of cameras"), and frames that see only distant points in common do not determine
    the distance between them: the residuals of such models are small, and only these figures show it.

    Parameters
    ----------
    model : pycolmap.Reconstruction

    Returns
    -------
    focal_std : float or None
        Standard deviation of the focal length, relative to it, if every observation had an error of 1 px; the median
        of several cameras; None if the matrix cannot be inverted.
    steps : dict of str to float
        For each frame, the smaller one of the standard deviations of the steps from the frame before and to the frame
        after it, relative to their lengths, for the mean residual of the model. The variance of the best determined
        step is subtracted: it is that of the scale of the whole model. Empty if the matrix cannot be inverted; without
        the two frames that fix the coordinate system.
    """
    options = pycolmap.BundleAdjustmentOptions(refine_focal_length=True, refine_extra_params=True)
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    covariance = pycolmap.estimate_ba_covariance(pycolmap.BACovarianceOptions(), model, adjuster)
    if covariance is None:
        return None, {}
    deviations = []
    for camera in model.cameras.values():
        of_camera = covariance.get_other_params_cov(camera.params)  # (p, p), the focal length first
        if of_camera is not None and of_camera[0, 0] >= 0:
            deviations.append(float(np.sqrt(of_camera[0, 0]) / camera.params[0]))
    focal_std = float(np.median(deviations)) if deviations and np.isfinite(deviations).all() else None

    images = sorted((image for image in model.images.values() if image.has_pose), key=lambda image: image.name)
    centres = np.array([image.projection_center() for image in images])
    extent = np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean())
    noise_px = model.compute_mean_reprojection_error()
    variances = np.full(max(len(images) - 1, 0), np.inf)
    for k in range(len(variances)):
        step = centres[k + 1] - centres[k]
        length = max(float(np.linalg.norm(step)), 1e-12)
        gradients = []
        for sign, image in ((-1.0, images[k]), (1.0, images[k + 1])):
            pose = image.cam_from_world()
            direction = pose.rotation.matrix() @ step / length
            # of the centre -R^T t along the step; COLMAP's tangent of R is half a rotation vector, on the left of R
            gradients += [-2.0 * sign * np.cross(direction, pose.translation), -sign * direction]
        gradient = np.concatenate(gradients)
        first, second = images[k].image_id, images[k + 1].image_id
        own, other = covariance.get_cam_cov_from_world(first), covariance.get_cam_cov_from_world(second)
        cross = covariance.get_cam_cross_cov_from_world(first, second)
        if all(block is not None and block.shape == (6, 6) for block in (own, cross, other)):
            variance = gradient @ np.block([[own, cross], [cross.T, other]]) @ gradient
            variances[k] = variance * (noise_px / max(length, MIN_STEP_RATIO * extent)) ** 2
    if not np.isfinite(variances).any():
        return focal_std, {}
    excess = np.sqrt(np.maximum(variances - variances.min(), 0.0))
    nearest = np.minimum(np.append(np.inf, excess), np.append(excess, np.inf))
    return focal_std, {image.name: float(std) for image, std in zip(images, nearest, strict=True) if std < np.inf}
