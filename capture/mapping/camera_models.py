"""Which camera model the frames ask for: each is fitted to most observations and judged by the rest."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator.projection.cameras import CAMERA_MODELS
from estimator.reconstructions.pycolmap_library import pycolmap
from metric_base.arrays import FloatArray

#: Models that are tried, simplest first. A telephone's lens is the first or second, an action camera's the third.
TRIED_MODELS = ("SIMPLE_RADIAL", "OPENCV", "OPENCV_FISHEYE")
#: Only points that so many views see lose one of their observations.
LEAST_TRACK = 4
#: Share of such points that lose one.
HELD_OUT = 0.5
#: A larger residual counts as this, in pixels: it is of a wrong match.
MOST_ERROR_PX = 3.0
#: A model with more parameters is taken where it lowers the residual of what was held out by this share.
LEAST_GAIN = 0.03


def model_scores(folder: str, models: tuple[str, ...] = TRIED_MODELS) -> dict[str, dict[str, Any]]:
    """Per camera model: root mean square residual in pixels of what was held out, and the fitted parameters.

    folder : of a model whose frames share a camera.
    """
    return {model: _score(pycolmap.Reconstruction(folder), model) for model in models}


def chosen_model(scores: dict[str, dict[str, Any]]) -> str:
    """The model that does best; one with more parameters than another has to beat it by `LEAST_GAIN`.

    >>> chosen_model({"SIMPLE_RADIAL": {"error_px": 1.0}, "OPENCV": {"error_px": 0.98}})
    'SIMPLE_RADIAL'
    >>> chosen_model({"OPENCV": {"error_px": 1.0}, "OPENCV_FISHEYE": {"error_px": 0.98}})
    'OPENCV_FISHEYE'
    """
    best, *others = sorted(scores, key=lambda name: len(CAMERA_MODELS[name][1]))
    for name in others:
        more = len(CAMERA_MODELS[name][1]) > len(CAMERA_MODELS[best][1])
        if scores[name]["error_px"] < (1 - LEAST_GAIN * more) * scores[best]["error_px"]:
            best = name
    return best


def start_params(camera: Any, model: str) -> list[float]:
    """Parameters of a camera model that moves pixels as `camera`, a `pycolmap.Camera`, does, as nearly as it can.

    Radial terms are fitted by least squares from the middle to the corners: r = f (t + k1 t^3 + k2 t^5) with t the
    tangent of the angle to the axis, or the angle itself in a fisheye model.
    """
    angle = "FISHEYE" in model
    middle = np.array([camera.width / 2, camera.height / 2])
    radius = np.linspace(0.05, 1.0, 40) * np.linalg.norm(middle)
    rays = np.asarray(camera.cam_from_img(middle + np.outer(radius, middle / np.linalg.norm(middle))))
    tangent = np.linalg.norm(rays[:, :2], axis=1)
    known = np.isfinite(tangent)
    t = np.arctan(tangent[known]) if angle else tangent[known]
    terms = np.column_stack([t, t**3, t**5]) if model != "SIMPLE_RADIAL" else np.column_stack([t, t**3])
    solution = np.linalg.lstsq(terms, radius[known], rcond=None)[0]
    focal = float(solution[0])
    bends = (*(solution[1:] / focal), 0.0)
    values = {"f": focal, "fx": focal, "fy": focal, "cx": middle[0], "cy": middle[1], "k": bends[0]}
    values |= {"k1": bends[0], "k2": bends[1]}
    return [float(values.get(name, 0.0)) for name in CAMERA_MODELS[model][1]]


def _score(model: Any, name: str) -> dict[str, Any]:
    (camera,) = model.cameras.values()
    if camera.model.name != name:
        params = start_params(camera, name)
        camera.model = getattr(pycolmap.CameraModelId, name)
        camera.params = params
    held = _hold_out(model)
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = 60
    pycolmap.bundle_adjustment(model, options)
    errors = _residuals(model, held)
    return {
        "error_px": float(np.sqrt((np.minimum(errors, MOST_ERROR_PX) ** 2).mean())) if len(errors) else np.inf,
        "params": [float(value) for value in camera.params],
    }


def _hold_out(model: Any) -> list[tuple[int, int, FloatArray]]:
    """Delete one observation of every second well seen point; image, point and pixel (2,) of each."""
    generator = np.random.default_rng(0)
    held = []
    for point_id in sorted(model.points3D):
        elements = model.points3D[point_id].track.elements
        if len(elements) < LEAST_TRACK or generator.random() > HELD_OUT:
            continue
        one = elements[int(generator.integers(len(elements)))]
        pixel = np.array(model.images[one.image_id].points2D[one.point2D_idx].xy)
        held.append((one.image_id, point_id, pixel))
        model.delete_observation(one.image_id, one.point2D_idx)
    return held


def _residuals(model: Any, held: list[tuple[int, int, FloatArray]]) -> FloatArray:
    """(n,) distances in pixels of what was held out; infinite where the point is behind the camera."""
    errors = []
    for image_id, point_id, pixel in held:
        place = model.images[image_id].project_point(model.points3D[point_id].xyz)
        errors.append(np.inf if place is None else np.linalg.norm(place - pixel))
    return np.asarray(errors, dtype=np.float64)
