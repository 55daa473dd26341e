"""Choose the camera model of a reconstruction by the residuals of observations that the adjustment did not see."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from capture.mapping.pose_refinement import MIN_FOCAL_POINTS
from capture.mapping.refusals import MAX_ASPECT
from estimator.projection.cameras import CAMERA_MODELS
from estimator.reconstructions.pycolmap_library import pycolmap

#: Models that are compared, simplest first: a phone's lens is the first or second, an action camera's the third.
CANDIDATE_MODELS = ("SIMPLE_RADIAL", "OPENCV", "OPENCV_FISHEYE")
#: Minimum number of views of a point that loses one of its observations, and fraction of such points that do.
MIN_TRACK_LENGTH, HELD_OUT_FRACTION = 4, 0.5
#: Maximum residual in pixels; larger ones are of wrong matches and count as this.
MAX_HELD_OUT_PX = 3.0
#: Minimum gain of a model over the simplest one, in standard errors of the gain between images. On the 17 images of
#: `seoul_bull` OPENCV gains 14 % in 1.8 standard errors and moves the path by 1.8 %; on `dino_toys` 18 % in 4.5.
MIN_GAIN_ERRORS = 3.0


class ModelScore(msgspec.Struct, frozen=True):
    """Fit of a camera model to a reconstruction, judged by held-out observations."""

    error_px: float  #: Root mean square residual.
    gain: float  #: Relative decrease of the mean square residual against the first model.
    gain_error: float  #: Standard error of the gain; images are clusters, because their residuals are correlated.
    params: list[float]  #: Fitted parameters of the camera.
    aspect: float = 1.0  #: Ratio of the larger to the smaller focal length across and down.


class CameraModelChoice(msgspec.Struct, frozen=True):
    """Comparison of camera models."""

    scores: dict[str, ModelScore]  #: By COLMAP's names.
    before: str  #: Model of the reconstruction.
    chosen: str  #: Model with the largest significant gain.

    @property
    def focal_difference(self) -> float:
        """Difference of the focal length of the chosen model from that of the model before, relative to the latter."""
        before, chosen = (self.scores[name].params[0] for name in (self.before, self.chosen))
        return chosen / before - 1


def model_scores(folder: Path, names: Sequence[str] = CANDIDATE_MODELS) -> dict[str, ModelScore]:
    """Fit each candidate model to most observations of a reconstruction and compare them on the rest.

    Half of the well seen points lose one observation each, the same ones for every model.

    Parameters
    ----------
    folder : Path
        Reconstruction whose images share a camera.
    names : sequence of str, default CANDIDATE_MODELS
        COLMAP's names of the models; the others are compared with the first.

    Returns
    -------
    dict of str to ModelScore
    """
    scores: dict[str, ModelScore] = {}
    first = np.zeros(0)
    for name in names:
        model = pycolmap.Reconstruction(folder)
        (camera,) = model.cameras.values()
        if camera.model.name != name:
            params = start_params(camera, name)
            camera.model = getattr(pycolmap.CameraModelId, name)
            camera.params = params
        generator = np.random.default_rng(0)
        held = []
        for point_id in sorted(model.points3D):
            elements = model.points3D[point_id].track.elements
            if len(elements) < MIN_TRACK_LENGTH or generator.random() > HELD_OUT_FRACTION:
                continue
            element = elements[int(generator.integers(len(elements)))]
            pixel = np.array(model.images[element.image_id].points2D[element.point2D_idx].xy)
            held.append((element.image_id, point_id, pixel))
            model.delete_observation(element.image_id, element.point2D_idx)
        options = _robust_options(print_summary=False)
        options.ceres.solver_options.max_num_iterations = 60
        pycolmap.bundle_adjustment(model, options)
        squares = np.full(len(held), MAX_HELD_OUT_PX**2)
        for row, (image_id, point_id, pixel) in enumerate(held):
            projected = model.images[image_id].project_point(model.points3D[point_id].xyz)
            if projected is not None:
                squares[row] = min(float(((projected - pixel) ** 2).sum()), squares[row])
        first = first if scores else squares
        gains = (first - squares) / first.mean()
        _, images = np.unique([image_id for image_id, _, _ in held], return_inverse=True)
        error = float(np.sqrt((np.bincount(images, gains - gains.mean()) ** 2).sum()) / len(gains))
        rms = float(np.sqrt(squares.mean()))
        aspect = max(camera.focal_length_x / camera.focal_length_y, camera.focal_length_y / camera.focal_length_x)
        params = [float(value) for value in camera.params]
        scores[name] = ModelScore(rms, float(gains.mean()), error, params, float(aspect))
    return scores


def chosen_model(scores: dict[str, ModelScore]) -> str:
    """Return the model with the largest significant gain over the first one, or the first one if none has any.

    A model whose focal lengths across and down differ by more than `MAX_ASPECT` is not eligible: pixels are square,
    and another ratio compensates for a rolling shutter (a rendered street: 1.5, with a path error of 2.7 %).

    >>> chosen_model({"SIMPLE_RADIAL": ModelScore(0.97, 0, 0, []), "OPENCV": ModelScore(0.92, 0.14, 0.07, [])})
    'SIMPLE_RADIAL'
    >>> chosen_model({"SIMPLE_RADIAL": ModelScore(1.4, 0, 0, []), "OPENCV": ModelScore(1.27, 0.18, 0.04, [])})
    'OPENCV'
    """
    significant = [
        name
        for name, score in scores.items()
        if score.gain > MIN_GAIN_ERRORS * score.gain_error and score.aspect <= MAX_ASPECT
    ]
    return max(significant, key=lambda name: scores[name].gain, default=next(iter(scores)))


def focal_change(folder: Path) -> tuple[float, float]:
    """Return the change of the logarithm of the focal length over the frames, and its standard error.

    Every frame gets a camera of its own, and focal lengths, poses and points are adjusted together: with points that a
    shared focal length has bent, a zoom of 30 % changes the frames' own focal lengths by 3 % only. The change is that
    of a linear regression from the first to the last frame in the order of the names, over the frames with
    `MIN_FOCAL_POINTS` points or more, and the error follows from its scatter.

    Parameters
    ----------
    folder : Path
        Reconstruction whose images share a camera, and of which at least three have enough points.
    """
    shared, model = pycolmap.Reconstruction(folder), pycolmap.Reconstruction()
    (camera,) = shared.cameras.values()
    images = sorted((image for image in shared.images.values() if image.has_pose), key=lambda image: image.name)
    for image in images:
        lens = pycolmap.Camera(
            model=camera.model, width=camera.width, height=camera.height, params=camera.params, camera_id=image.image_id
        )
        model.add_camera_with_trivial_rig(lens)
        pixels = np.array([point.xy for point in image.points2D])
        own = pycolmap.Image(name=image.name, keypoints=pixels, camera_id=image.image_id, image_id=image.image_id)
        model.add_image_with_trivial_frame(own, image.cam_from_world())
    for point in shared.points3D.values():
        elements = [element for element in point.track.elements if element.image_id in model.images]
        model.add_point3D(point.xyz, pycolmap.Track(elements), point.color)
    pycolmap.bundle_adjustment(model, _robust_options(print_summary=False, refine_extra_params=False))
    counts = {image.image_id: image.num_points3D for image in model.images.values()}
    focals = [
        model.cameras[image.image_id].focal_length_x for image in images if counts[image.image_id] >= MIN_FOCAL_POINTS
    ]
    logs = np.log(focals)
    position = np.linspace(-0.5, 0.5, len(logs))
    change = float(position @ logs / (position @ position))
    scatter = logs - logs.mean() - change * position
    return change, float(np.sqrt(scatter @ scatter / (len(logs) - 2) / (position @ position)))


def _robust_options(**settings: bool) -> Any:
    """Return options of a bundle adjustment with a robust loss that gives the same result in every run."""
    options = pycolmap.BundleAdjustmentOptions(**settings)
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.solver_options.num_threads = 1
    return options


def start_params(camera: Any, model: str) -> list[float]:
    """Return parameters of a camera model that project almost as another camera does.

    Radial terms are fitted by least squares from the centre to the corners: r = f (t + k1 t^3 + k2 t^5) with t the
    tangent of the angle to the axis, or the angle itself in a fisheye model.

    Parameters
    ----------
    camera : pycolmap.Camera
    model : str
        COLMAP's name of the model.
    """
    centre = np.array([camera.width / 2, camera.height / 2])
    radius = np.linspace(0.05, 1.0, 40) * np.linalg.norm(centre)
    rays = np.asarray(camera.cam_from_img(centre + np.outer(radius, centre / np.linalg.norm(centre))))
    tangent = np.linalg.norm(rays[:, :2], axis=1)
    known = np.isfinite(tangent)
    t = np.arctan(tangent[known]) if "FISHEYE" in model else tangent[known]
    terms = np.column_stack([t, t**3, t**5]) if model != "SIMPLE_RADIAL" else np.column_stack([t, t**3])
    solution = np.linalg.lstsq(terms, radius[known], rcond=None)[0]
    focal = float(solution[0])
    k1, k2 = (*(solution[1:] / focal), 0.0)[:2]
    values = {"f": focal, "fx": focal, "fy": focal, "cx": centre[0], "cy": centre[1], "k": k1, "k1": k1, "k2": k2}
    return [float(values.get(name, 0.0)) for name in CAMERA_MODELS[model][1]]
