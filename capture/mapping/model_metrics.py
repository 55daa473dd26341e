"""What the frames, their matches and the models say about whether a capture can be used."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from capture.mapping.pose_refinement import focal_spread
from estimator.projection.cameras import CAMERA_MODELS, project
from estimator.reconstructions.colmap import read_colmap
from estimator.records.scene import Camera, Scene
from metric_base.arrays import FloatArray

#: Points looked at for the angle of triangulation.
SAMPLE = 2000
#: Cells to a side in which residuals are looked at for a pattern, and the fewest residuals that say something of one.
GRID, LEAST_IN_CELL = 8, 20


@dataclass(frozen=True, slots=True)
class TripletAgreement:
    """How well a model agrees with the verified matches of three frames at a time.

    frames : of the model; triplets : how many were looked at; contradicted : how many of them the model contradicts;
    residual_px : their median residual; pieces : frames that triplets hold together, largest piece first; broken :
    frames of the largest piece at which the size of the steps breaks.
    """

    frames: int = 0
    triplets: int = 0
    contradicted: int = 0
    residual_px: float = 0.0
    pieces: tuple[tuple[str, ...], ...] = ()
    broken: tuple[str, ...] = ()

    @property
    def share(self) -> float:
        """Share of the triplets that the model contradicts."""
        return self.contradicted / max(self.triplets, 1)

    def json(self) -> dict[str, Any]:
        """For a line of JSON; `agreement_of` reads it."""
        return {
            "frames": self.frames,
            "triplets": self.triplets,
            "contradicted": self.contradicted,
            "residual_px": self.residual_px,
            "pieces": [list(piece) for piece in self.pieces],
            "broken": list(self.broken),
        }


def agreement_of(row: dict[str, Any] | None) -> TripletAgreement | None:
    """What `TripletAgreement.json` wrote."""
    if row is None:
        return None
    pieces = tuple(tuple(piece) for piece in row["pieces"])
    return TripletAgreement(**row | {"pieces": pieces, "broken": tuple(row["broken"])})


@dataclass(frozen=True, slots=True, eq=False)
class ModelShape:
    """A model as the gates see it.

    names : registered frames; centres : (v, 3); points : how many; angle_deg : median over the
    points of the widest angle between two views of it; error_px : median reprojection error; focal : over the longer
    side; lens_bend : largest displacement by the lens within the picture, as a share of the longer side;
    focal_deviation : of `focal_deviation`, None where it could not be computed; focal_spread : of `focal_spread`;
    pattern : of `residual_pattern`; camera : COLMAP's camera model; agreement : with the matches of three frames;
    aspect : how far pixels come out from square, fy over fx or its inverse; seam : of `weakest_seam`.
    """

    names: tuple[str, ...]
    centres: FloatArray
    points: int
    angle_deg: float
    error_px: float
    focal: float
    lens_bend: float
    focal_deviation: float | None = None
    focal_spread: float | None = None
    pattern: float = 0.0
    camera: str = "SIMPLE_RADIAL"
    agreement: TripletAgreement = TripletAgreement()
    aspect: float = 1.0
    seam: int = 0

    def summary(self) -> dict[str, Any]:
        """Figures for the report."""
        return {
            "registered": len(self.names),
            "points": self.points,
            "angle_deg": self.angle_deg,
            "error_px": self.error_px,
            "focal": self.focal,
            "lens_bend": self.lens_bend,
            "focal_deviation": self.focal_deviation,
            "focal_spread": self.focal_spread,
            "pattern": self.pattern,
            "camera": self.camera,
            "aspect": self.aspect,
            "seam": self.seam,
            "triplets": self.agreement.triplets,
            "contradicted": self.agreement.contradicted,
            "pieces": [len(piece) for piece in self.agreement.pieces],
            "broken": list(self.agreement.broken),
        }


def model_shape(
    folder: Path, focal_deviation: float | None = None, agreement: TripletAgreement | None = None
) -> ModelShape | None:
    """The shape of a model on disk, None where there is none or it has no point; the others are of that model."""
    if not (folder / "images.bin").is_file():
        return None
    scene = read_colmap(folder)
    if not len(scene.points):
        return None
    camera = scene.views[0].camera
    side = max(camera.width, camera.height)
    residuals, pixels = _residuals(scene)
    return ModelShape(
        tuple(view.name for view in scene.views),
        np.array([view.centre for view in scene.views]),
        len(scene.points),
        _median_angle(scene),
        float(np.nanmedian(np.linalg.norm(residuals, axis=1))),
        float(camera.params[0]) / side,
        _lens_bend(scene) / side,
        focal_deviation,
        focal_spread(scene),
        residual_pattern(residuals, pixels, (camera.width, camera.height)),
        camera.model,
        agreement or TripletAgreement(),
        _aspect(camera),
        weakest_seam(scene),
    )


def weakest_seam(scene: Scene) -> int:
    """Points that pass the size on where fewest do: seen by two views or more on either side of a cut between two.

    The views are taken in the order of their names, as they were recorded. Two at least are on either side.
    """
    ordered = sorted(scene.views, key=lambda view: view.name)
    if len(ordered) < 4:
        return 0
    view = np.repeat(np.arange(len(ordered)), [len(one.point_index) for one in ordered])
    seen = np.unique(np.column_stack([np.concatenate([one.point_index for one in ordered]), view]), axis=0)
    _, first, count = np.unique(seen[:, 0], return_index=True, return_counts=True)
    first, count = first[count >= 4], count[count >= 4]
    begin, end = seen[first + 1, 1] + 1, seen[first + count - 2, 1]  # the first and the last cut of each, as view after
    steps = np.bincount(begin, minlength=len(ordered) + 2) - np.bincount(end + 1, minlength=len(ordered) + 2)
    return int(np.cumsum(steps)[2 : len(ordered) - 1].min())


def _aspect(camera: Camera) -> float:
    """The larger of fy / fx and its inverse; 1 of a model with one focal length."""
    values = dict(zip(CAMERA_MODELS[camera.model][1], camera.params, strict=True))
    ratio = float(values["fy"] / values["fx"]) if "fy" in values else 1.0
    return max(ratio, 1 / ratio) if ratio > 0 else float("inf")


def model_disagreement(one: ModelShape, two: ModelShape | None) -> float | None:
    """Root mean square distance between the camera centres of two models after alignment, over their extent.

    None where they share fewer than half of the smaller model's frames.
    """
    if two is None:
        return None
    rows = {name: row for row, name in enumerate(two.names)}
    shared = [(a, rows[name]) for a, name in enumerate(one.names) if name in rows]
    if len(shared) < max(3, len(two.names) // 2):
        return None
    first, second = (np.array([model.centres[pair[k]] for pair in shared]) for k, model in enumerate((one, two)))
    extent = float(np.sqrt(((first - first.mean(axis=0)) ** 2).sum(axis=1).mean()))
    moved = aligned_centres(second, first)
    return float(np.sqrt(((moved - first) ** 2).sum(axis=1).mean()) / max(extent, 1e-12))


def aligned_centres(source: FloatArray, target: FloatArray) -> FloatArray:
    """Source (n, 3) under the similarity that brings it nearest to target (Umeyama 1991)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, d, vt = np.linalg.svd(b.T @ a / len(a))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = (u * sign) @ vt
    scale = float((d * sign).sum() / max((a**2).sum(axis=1).mean(), 1e-30))
    aligned: FloatArray = scale * a @ rotation.T + target.mean(axis=0)
    return aligned


def _steps_from(frame: int, near: dict[int, set[int]]) -> int:
    """Steps from a frame to the one that is farthest from it."""
    reached, border, steps = {frame}, {frame}, 0
    while border := {other for one in border for other in near.get(one, ())} - reached:
        reached |= border
        steps += 1
    return steps


def _median_angle(scene: Scene) -> float:
    """Median over points of the widest angle between the rays of two views that see the point, degrees."""
    rows = np.concatenate([view.point_index for view in scene.views])
    views = np.concatenate([np.full(len(view.point_index), k) for k, view in enumerate(scene.views)])
    order = np.argsort(rows, kind="stable")
    rows, views = rows[order], views[order]
    ids, starts = np.unique(rows, return_index=True)
    chosen = np.unique(np.linspace(0, len(ids) - 1, min(len(ids), SAMPLE)).astype(np.int64))
    ends = np.append(starts[1:], len(rows))
    centres = np.array([view.centre for view in scene.views])
    angles = []
    for k in chosen:
        rays = scene.points[ids[k]] - centres[views[starts[k] : ends[k]]]
        rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
        angles.append(np.degrees(np.arccos(np.clip((rays @ rays.T).min(), -1, 1))))
    return float(np.median(angles))


def _residuals(scene: Scene) -> tuple[FloatArray, FloatArray]:
    """(n, 2) pixels from every observation to the projection of its point, and (n, 2) the observations."""
    residuals = []
    for view in scene.views:
        local = scene.points[view.point_index] @ view.rotation.T + view.translation
        residuals.append(project(view.camera, local) - view.keypoints)
    return np.concatenate(residuals), np.concatenate([view.keypoints for view in scene.views])


def residual_pattern(residuals: FloatArray, pixels: FloatArray, size: tuple[int, int]) -> float:
    """How much of the residuals depends on the place in the picture alone, as a share of their spread.

    residuals, pixels : (n, 2); size : (width, height). With cells c of a grid, n_c residuals in each, their mean m_c
    and variance v_c: sqrt(sum (n_c |m_c|^2 - v_c) / sum (n_c v_c)). A lens that the camera model describes leaves 0.
    """
    known = np.isfinite(residuals).all(axis=1)
    residuals, pixels = residuals[known], pixels[known]
    places = np.clip((pixels / size * GRID).astype(np.int64), 0, GRID - 1)
    cells = places[:, 0] * GRID + places[:, 1]
    explained, whole = 0.0, 0.0
    for cell in np.unique(cells):
        rows = residuals[cells == cell]
        if len(rows) < LEAST_IN_CELL:
            continue
        middle = rows.mean(axis=0)
        variance = float(((rows - middle) ** 2).sum() / (len(rows) - 1))
        explained += len(rows) * float(middle @ middle) - variance
        whole += len(rows) * variance
    return float(np.sqrt(max(explained, 0.0) / whole)) if whole > 0 else 0.0


def _lens_bend(scene: Scene) -> float:
    """Pixels by which the lens moves the corners of the picture from where a pinhole has them."""
    camera = scene.views[0].camera
    focal, centre = camera.params[0], np.array([camera.width / 2, camera.height / 2])
    corners = np.array([[x, y] for x in (0, camera.width) for y in (0, camera.height)], dtype=np.float64)
    rays = np.column_stack([(corners - centre) / focal, np.ones(4)])
    return float(np.nan_to_num(np.linalg.norm(project(camera, rays) - corners, axis=1), nan=1e9).max())


def _rotation_misfit(homography: FloatArray, size: tuple[int, int]) -> FloatArray:
    """(f,) how far K^-1 H K is from a rotation, at focal lengths of 0.4 to 3 times the longer side.

    A rotation's singular values are equal: the misfit is the logarithm of the ratio of the largest to the smallest.
    """
    focals = np.geomspace(0.4, 3.0, 25) * max(size)
    k = np.tile(np.array([[0, 0, size[0] / 2], [0, 0, size[1] / 2], [0, 0, 1.0]]), (len(focals), 1, 1))
    k[:, 0, 0] = k[:, 1, 1] = focals
    values = np.linalg.svd(np.linalg.inv(k) @ homography @ k, compute_uv=False)  # (f, 3)
    return np.asarray(np.log(values[:, 0] / np.maximum(values[:, 2], 1e-12)))
