"""Figures of a model by which it is judged: residuals, camera, and agreement with the matches."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from capture.mapping.pose_refinement import focal_variation
from capture.mapping.triplets import TripletAgreement
from estimator.projection.cameras import CAMERA_MODELS, project
from estimator.reconstructions.colmap import read_colmap
from estimator.records.scene import Camera, Scene
from metric_base.arrays import FloatArray

#: Cells per side in which residuals are averaged, and minimum number of residuals of a cell.
N_GRID_CELLS, MIN_CELL_RESIDUALS = 8, 20


class ModelMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """Figures of a model, as in `reconstruction.json`."""

    names: tuple[str, ...]  #: Placed frames.
    points: int  #: Number of points.
    error_px: float  #: Median reprojection error.
    focal: float  #: Focal length relative to the longer side.
    lens_bend: float  #: Maximum displacement by the distortion in the image, relative to the longer side.
    camera: str  #: COLMAP's camera model.
    aspect: float = 1.0  #: Ratio of the larger to the smaller focal length across and down.
    focal_deviation: float | None = None  #: Standard deviation of the focal length, relative, for residuals of 1 px.
    focal_spread: float | None = None  #: Standard deviation of the frames' own focal lengths beyond their noise.
    focal_change: float = 0.0  #: `camera_models.focal_change`, computed if `focal_spread` is large.
    focal_change_error: float = 0.0  #: Standard error of `focal_change`.
    pattern: float = 0.0  #: `residual_pattern`.
    triplets: int = 0  #: Number of triplets of frames within the largest part.
    contradicted: int = 0  #: Number of these that the model contradicts.
    pieces: tuple[int, ...] = ()  #: Number of frames of each part that triplets hold together.
    broken: tuple[str, ...] = ()  #: Frames at which the length of the steps changes.
    step_deviation: float | None = None  #: Largest standard deviation of a step between frames, relative to it.
    undetermined: tuple[str, ...] = ()  #: Frames that are not used, because no step to them is determined.

    @property
    def registered(self) -> int:
        """Number of placed frames."""
        return len(self.names)


def model_metrics(folder: Path, focal_deviation: float | None, agreed: TripletAgreement) -> ModelMetrics:
    """Return the figures of the model in a folder.

    Parameters
    ----------
    folder : Path
        Model in COLMAP's form with at least one point.
    focal_deviation : float or None
        Standard deviation of its focal length.
    agreed : TripletAgreement
        Its agreement with the matches of three frames.
    """
    scene = read_colmap(folder)
    camera = scene.views[0].camera
    residuals, pixels, size = residuals_of(scene)
    values = dict(zip(CAMERA_MODELS[camera.model][1], camera.params, strict=True))
    ratio = float(values.get("fy", 1.0) / values.get("fx", 1.0))
    return ModelMetrics(
        names=tuple(view.name for view in scene.views),
        points=len(scene.points),
        error_px=float(np.nanmedian(np.linalg.norm(residuals, axis=1))),
        focal=camera.focal_px / max(camera.width, camera.height),
        lens_bend=lens_bend(camera),
        camera=camera.model,
        aspect=max(ratio, 1 / ratio) if ratio > 0 else float("inf"),
        focal_deviation=focal_deviation,
        focal_spread=focal_variation(scene),
        pattern=residual_pattern(residuals, pixels, size),
        triplets=agreed.triplets,
        contradicted=agreed.contradicted,
        pieces=tuple(len(part) for part in agreed.parts),
        broken=agreed.broken,
    )


def lens_bend(camera: Camera) -> float:
    """Return the maximum displacement of a corner of the image by the distortion, relative to the longer side."""
    centre = np.array([camera.width / 2, camera.height / 2])
    corners = np.array([[x, y] for x in (0, camera.width) for y in (0, camera.height)], dtype=np.float64)
    rays = np.column_stack([(corners - centre) / camera.params[0], np.ones(4)])
    bend = np.nan_to_num(np.linalg.norm(project(camera, rays) - corners, axis=1), nan=1e9).max()
    return float(bend) / max(camera.width, camera.height)


def residuals_of(scene: Scene) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
    """Return the residuals and the pixels (n, 2) of all observations, and the size of the first view."""
    seen = [(view, view.to_camera(scene.points[view.point_index])) for view in scene.views]
    residuals = [project(view.camera, local) - view.keypoints for view, local in seen]
    camera = scene.views[0].camera
    pixels = np.concatenate([view.keypoints for view in scene.views])
    return np.concatenate(residuals), pixels, (camera.width, camera.height)


def residual_pattern(residuals: FloatArray, pixels: FloatArray, size: tuple[int, int]) -> float:
    """Return the part of the residuals that depends on the position in the image alone, relative to their spread.

    With cells c of a grid, n_c residuals of mean m_c and variance v_c in each, it is the square root of
    sum (n_c |m_c|^2 - v_c) / sum (n_c v_c). It is 0 if the camera model describes the lens.

    Parameters
    ----------
    residuals, pixels : (n, 2) arrays
    size : (int, int)
        Width and height of the image.
    """
    known = np.isfinite(residuals).all(axis=1)
    residuals, pixels = residuals[known], pixels[known]
    places = np.clip((pixels / size * N_GRID_CELLS).astype(np.int64), 0, N_GRID_CELLS - 1)
    cells = places[:, 0] * N_GRID_CELLS + places[:, 1]
    explained, whole = 0.0, 0.0
    for cell in np.unique(cells):
        rows = residuals[cells == cell]
        if len(rows) < MIN_CELL_RESIDUALS:
            continue
        middle = rows.mean(axis=0)
        variance = float(((rows - middle) ** 2).sum() / (len(rows) - 1))
        explained += len(rows) * float(middle @ middle) - variance
        whole += len(rows) * variance
    return float(np.sqrt(max(explained, 0.0) / whole)) if whole > 0 else 0.0
