"""Agreement of a model with the verified matches of three frames at a time, and the parts that they hold together."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.reconstructions.pycolmap_library import pycolmap
from metric_base.arrays import FloatArray, IntArray, grouped
from metric_base.statistics import robust_sigma

#: Maximum median residual in pixels of a triplet that agrees with the model: right models of twelve real sets stay
#: below 1.2 px but for one triplet of 3.7; models with a wrong part reach 4 to 50.
MAX_RESIDUAL_PX = 2.5
#: Maximum logarithm of the ratio of the sizes of the two pairs of frames, beyond three standard errors. Along a walk
#: straight ahead a part that is too large has small residuals, and only its steps are too long.
MAX_STRETCH = 0.1
#: Maximum ratio of the second to the largest part of a usable model. The parts have no known scale relative to each
#: other. A skull under a moving flash (`skull_flash`) fell into 37 and 32 frames; right models have at most 0.17.
MAX_PART_RATIO = 0.5
#: Minimum parallax in pixels of features whose depths are compared, and minimum number of such features.
MIN_PARALLAX_PX, MIN_DEPTHS = 8.0, 8
#: Longer side in pixels of the images to which residuals and parallax refer; smaller images are not enlarged.
REFERENCE_SIDE = 1000
#: Minimum number of features that three frames have in common, and maximum number that is tested.
MIN_COMMON, MAX_COMMON = 8, 200
#: Distances in order between the frames of a triplet, and number of frames with most matches with which each frame
#: forms triplets, too. Direct neighbours move too little on a walk straight ahead for their depths
#: to be compared.
STEPS, N_STRONGEST = (1, 4), 4


@dataclass(frozen=True, slots=True)
class Triplet:
    """Three frames with features in common."""

    names: tuple[str, str, str]  #: The middle frame is second.
    common: int  #: Number of features in common.
    residual_px: float  #: Their median residual.
    stretch: float = 0.0  #: Logarithm of the ratio of depths by the last two and the first two frames, beyond `noise`.
    noise: float = np.inf  #: Three standard errors of the stretch; infinite if too few features move enough.

    @property
    def breaks(self) -> bool:
        """Whether the sizes of the two pairs of frames differ."""
        return abs(self.stretch) > MAX_STRETCH

    @property
    def compares_size(self) -> bool:
        """Whether the noise is small enough to detect a difference in size."""
        return self.breaks or self.noise <= MAX_STRETCH

    @property
    def fits(self) -> bool:
        """Whether the model agrees with the three frames."""
        return self.residual_px <= MAX_RESIDUAL_PX and not self.breaks


@dataclass(frozen=True, slots=True)
class TripletAgreement:
    """Agreement of a model with the verified matches of three frames at a time."""

    triplets: int = 0  #: Number of triplets within the largest part.
    contradicted: int = 0  #: Number of these that the model contradicts.
    parts: tuple[tuple[str, ...], ...] = ()  #: Frames that triplets hold together, largest part first.
    broken: tuple[str, ...] = ()  #: Frames of the largest part at which the length of the steps changes.
    loose: tuple[str, ...] = ()  #: Frames of triplets outside the largest part.

    @property
    def is_split(self) -> bool:
        """Whether the second part is large relative to the first; their relative scale is unknown."""
        return len(self.parts) > 1 and len(self.parts[1]) > MAX_PART_RATIO * len(self.parts[0])


def agreement(triplets: list[Triplet]) -> TripletAgreement:
    """Return the agreement of triplets with their model, and the parts that they hold together.

    Triplets that agree with the model belong to one part if they share two frames. One common frame transfers no
    scale, so that two parts with no more have any size relative to each other.
    """
    parts: list[tuple[set[frozenset[str]], set[str]]] = []  # pairs of frames, and frames
    for row in (row for row in triplets if row.fits):
        pairs, names = {frozenset(pair) for pair in itertools.combinations(row.names, 2)}, set(row.names)
        for part in [part for part in parts if part[0] & pairs]:
            parts.remove(part)
            pairs, names = pairs | part[0], names | part[1]
        parts.append((pairs, names))
    ordered = sorted((tuple(sorted(names)) for _, names in parts), key=lambda names: (-len(names), names))
    largest = set(ordered[0]) if ordered else set()
    within = [row for row in triplets if largest.issuperset(row.names)]
    contradicted = sum(not row.fits for row in within)
    loose = {name for row in triplets for name in row.names} - largest
    return TripletAgreement(len(within), contradicted, tuple(ordered), broken_frames(within), tuple(sorted(loose)))


def broken_frames(triplets: list[Triplet]) -> tuple[str, ...]:
    """Return the frames at which the length of the steps changes by more than half of the triplets that detect it.

    If a part in the middle of a long walk is too large, only the few triplets at its two ends show it.
    """
    breaks = grouped((row.names[1], row.breaks) for row in triplets if row.compares_size)
    return tuple(sorted(name for name, rows in breaks.items() if 2 * sum(rows) > len(rows)))


def model_triplets(model: Any, database: str) -> list[Triplet]:
    """Return triplets of placed frames with their residuals by the verified matches of a database.

    Each frame is the middle of triplets with the frames before and after it and with those that it shares most
    verified matches with. The features that the middle one has in common with both others are triangulated from the
    three views with the poses of the model. A mapper drops matches that contradict its model, so that the residuals of
    the others are small in a wrong model, too; these are all matches.

    Parameters
    ----------
    model : pycolmap.Reconstruction
    database : str
        Path of the database.
    """
    with pycolmap.Database.open(database) as opened:
        names = {image.image_id: image.name for image in opened.read_all_images()}
        posed = {image.name: image for image in model.images.values() if image.has_pose}
        ids = [image_id for image_id in sorted(names, key=lambda key: names[key]) if names[image_id] in posed]
        pairs, counts = opened.read_two_view_geometry_num_inliers()
        known = {}
        for pair, count in zip(pairs, counts, strict=True):
            first, second = pycolmap.pair_id_to_image_pair(pair)
            if count >= 2 * MIN_COMMON and names[first] in posed and names[second] in posed:
                known[first, second] = count
        rays = {key: _rays(model, posed[names[key]], np.asarray(opened.read_keypoints(key))) for key in ids}
        triplets = []
        for a, b, c in _chosen_triples(ids, known):
            # Numbers (n, 3) of the features that the verified matches of (a, b) and of (b, c) share.
            first, second = _matches(opened, a, b), _matches(opened, c, b)
            common, one, two = np.intersect1d(first[:, 1], second[:, 1], return_indices=True)
            rows = np.column_stack([first[one, 0], common, second[two, 0]]).astype(np.int64)
            features = rows[:: max(1, len(rows) // MAX_COMMON)]
            if len(features) < MIN_COMMON:
                continue
            poses = np.array([posed[names[key]].cam_from_world().matrix() for key in (a, b, c)])
            seen = np.stack([rays[key][rows] for key, rows in zip((a, b, c), features.T, strict=True)], axis=1)
            seen = seen[np.isfinite(seen).all(axis=(1, 2))]
            angles = triplet_residuals(poses, seen)
            camera = model.cameras[posed[names[b]].camera_id]
            focal = camera.params[0] / max(1.0, max(camera.width, camera.height) / REFERENCE_SIDE)
            stretch, noise = triplet_stretch(poses, seen, MIN_PARALLAX_PX / focal)
            residual = float(np.median(angles) * focal)
            triplets.append(Triplet((names[a], names[b], names[c]), len(angles), residual, stretch, noise))
    return triplets


def triplet_residuals(poses: FloatArray, rays: FloatArray) -> FloatArray:
    """Return the largest angle (n,) in radians between a feature's ray and the direction of its point, over its views.

    A point is the least squares solution of ray x (R X + t w) = 0 over all views, which includes points at infinity.

    Parameters
    ----------
    poses : (k, 3, 4) ndarray of float
        From the world to each camera.
    rays : (n, k, 3) ndarray of float
        Unit vectors of the cameras.
    """
    if not len(rays):
        return np.zeros(0)
    centre = -np.einsum("kji,kj->ki", poses[:, :, :3], poses[:, :, 3]).mean(axis=0)
    shift = poses[:, :, :3] @ centre + poses[:, :, 3]  # the origin is between the cameras, their distance the unit
    unit = max(float(np.linalg.norm(shift, axis=1).max()), 1e-12)
    moved = np.concatenate([poses[:, :, :3], (shift / unit)[:, :, None]], axis=2)
    rows = np.swapaxes(np.cross(rays[:, :, None], np.swapaxes(moved, 1, 2)), 2, 3)  # (n, k, 3, 4)
    point = np.linalg.svd(rows.reshape(len(rays), -1, 4))[2][:, -1]  # (n, 4)
    seen = np.einsum("kij,nj->nki", moved, point)
    seen *= np.where(np.einsum("nki,nki->n", seen, rays) < 0, -1.0, 1.0)[:, None, None]
    seen /= np.maximum(np.linalg.norm(seen, axis=2, keepdims=True), 1e-12)
    return np.asarray(2 * np.arcsin(np.clip(np.linalg.norm(seen - rays, axis=2) / 2, 0, 1)).max(axis=1))


def triplet_stretch(poses: FloatArray, rays: FloatArray, min_parallax: float) -> tuple[float, float]:
    """Return the logarithm of the ratio of depths by frames two and three and by frames one and two, and its noise.

    The noise, three standard errors of the median, is subtracted. It is infinite if too few features move enough.

    Parameters
    ----------
    poses : (3, 3, 4) ndarray of float
    rays : (n, 3, 3) ndarray of float
        As for `triplet_residuals`.
    min_parallax : float
        In radians.
    """
    world = np.einsum("kji,nkj->nki", poses[:, :, :3], rays)
    centres = -np.einsum("kji,kj->ki", poses[:, :, :3], poses[:, :, 3])
    depths = []
    for other in (0, 2):
        across = (world[:, 1] * world[:, other]).sum(axis=1)  # cosine of the parallax
        base = centres[other] - centres[1]
        along, beyond = world[:, 1] @ base, world[:, other] @ base
        sine2 = 1 - across**2
        depth = (along - across * beyond) / np.maximum(sine2, 1e-12)
        depths.append(np.where((depth > 0) & (sine2 > np.sin(min_parallax) ** 2), depth, np.nan))
    ratio = np.log(depths[1] / depths[0])
    ratio = ratio[np.isfinite(ratio)]
    if len(ratio) < MIN_DEPTHS:
        return 0.0, np.inf
    middle = float(np.median(ratio))
    noise = 3 * robust_sigma(ratio) / np.sqrt(len(ratio))
    return float(np.sign(middle) * max(abs(middle) - noise, 0.0)), float(noise)


def _chosen_triples(ids: list[int], known: dict[tuple[int, int], int]) -> list[tuple[int, int, int]]:
    """Return triples (a, b, c) of frames, b the middle one, of which (a, b) and (b, c) have matches; ids : in order."""
    near: dict[int, dict[int, int]] = {key: {} for key in ids}
    for (a, b), count in known.items():
        near[a][b] = near[b][a] = count
    chosen = []
    for place, b in enumerate(ids):
        strongest = sorted(near[b], key=lambda key: (-near[b][key], key))[:N_STRONGEST]
        pairs = {(a, c) for k, a in enumerate(strongest) for c in strongest[k + 1 :]}
        for step in STEPS:
            if step <= place < len(ids) - step:
                before, after = ids[place - step], ids[place + step]
                if {before, after} <= near[b].keys():
                    pairs = {pair for pair in pairs if set(pair) != {before, after}} | {(before, after)}
        chosen += [(a, b, c) for a, c in sorted(pairs)]
    return chosen


def _matches(database: Any, one: int, two: int) -> IntArray:
    """Return the verified matches (m, 2), features of `one` first."""
    return np.asarray(database.read_two_view_geometry(one, two).inlier_matches, dtype=np.int64).reshape(-1, 2)


def _rays(model: Any, image: Any, keypoints: FloatArray) -> FloatArray:
    """Return the unit rays (n, 3) of the features (n, 2 or more) of a placed frame."""
    plane = np.asarray(model.cameras[image.camera_id].cam_from_img(keypoints[:, :2].astype(np.float64)))
    rays = np.column_stack([plane, np.ones(len(plane))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
