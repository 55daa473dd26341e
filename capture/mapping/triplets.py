"""Whether a model agrees with the matches of three frames at a time, and which frames hang together by them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.reconstructions.pycolmap_library import pycolmap
from metric_base.arrays import FloatArray, IntArray

#: A triplet agrees with the model up to this median residual: right models of twelve real sets stay below 1.2 px
#: but for one triplet of 3.7; models with a wrong piece reach 4 to 50.
MOST_RESIDUAL_PX = 2.5
#: ... and the two pairs of frames may differ in size by this much, beyond three times what the noise explains. Along a
#: walk straight ahead a piece that is too large leaves small residuals, and its steps alone are too long.
MOST_STRETCH = 0.1
#: Depths are compared of features that move by so many pixels against each other from frame to frame, and of so many.
LEAST_PARALLAX_PX, LEAST_DEPTHS = 8.0, 8
#: Larger pictures are reduced to this longer side before features are looked for, and residuals are in its pixels.
FEATURE_SIDE = 1000
#: Features that three frames must have in common, and the most that are looked at.
LEAST_COMMON, MOST_COMMON = 8, 200
#: Triplets that each frame is the middle of: with frames so far before and after it, and with those that it shares
#: most matches with. Neighbours alone move too little on a walk straight ahead for their depths to be compared.
STEPS, STRONGEST = (1, 4), 4


@dataclass(frozen=True, slots=True)
class Triplet:
    """Three frames by name, the middle one second.

    common : how many features they have in common; residual_px : median residual of these; stretch : logarithm of the
    factor between their depths by the first two frames and by the last two, as far as it is beyond its noise; noise :
    of the stretch, three standard errors, infinite where too few features move enough.
    """

    names: tuple[str, str, str]
    common: int
    residual_px: float
    stretch: float = 0.0
    noise: float = np.inf

    @property
    def breaks(self) -> bool:
        """Whether the two pairs of frames differ in size."""
        return abs(self.stretch) > MOST_STRETCH

    @property
    def compares_size(self) -> bool:
        """Whether it would show that the two pairs of frames differ in size."""
        return self.breaks or self.noise <= MOST_STRETCH

    @property
    def fits(self) -> bool:
        """Whether the model agrees with the three frames."""
        return self.residual_px <= MOST_RESIDUAL_PX and not self.breaks


@dataclass(frozen=True, slots=True)
class TripletAgreement:
    """Agreement of a model with the verified matches of three frames at a time."""

    frames: int = 0  #: Number of frames of the model.
    triplets: int = 0  #: Number of triplets within the largest part.
    contradicted: int = 0  #: Number of these that the model contradicts.
    parts: tuple[tuple[str, ...], ...] = ()  #: Frames that triplets hold together, largest part first.
    broken: tuple[str, ...] = ()  #: Frames of the largest part at which the length of the steps changes.
    loose: tuple[str, ...] = ()  #: Frames of triplets outside the largest part.


def agreement(triplets: list[Triplet], frames: int) -> TripletAgreement:
    """Whether the triplets of a model of so many frames agree with it, and into which pieces its frames fall.

    Frames of triplets that agree belong to one piece where two triplets share two frames: one frame alone passes on no
    size, and two pieces that share no more may have any size against each other.
    """
    fitting = [row for row in triplets if row.fits]
    joined: list[tuple[set[frozenset[str]], set[str]]] = []
    for row in fitting:
        sides, held = {frozenset(pair) for pair in itertools.combinations(row.names, 2)}, set(row.names)
        apart = []
        for piece in joined:
            if piece[0] & sides:
                sides, held = sides | piece[0], held | piece[1]
            else:
                apart.append(piece)
        joined = [*apart, (sides, held)]
    pieces = sorted((tuple(sorted(held)) for _, held in joined), key=lambda names: (-len(names), names))
    held = set(pieces[0]) if pieces else set()
    within = [row for row in triplets if held.issuperset(row.names)]
    contradicted = sum(not row.fits for row in within)
    loose = {name for row in triplets for name in row.names} - held
    return TripletAgreement(
        frames, len(within), contradicted, tuple(pieces), broken_frames(within), tuple(sorted(loose))
    )


def broken_frames(triplets: list[Triplet]) -> tuple[str, ...]:
    """The frames at which the size of the steps breaks: more than half of the triplets that would show it do.

    Where a piece in the middle of a long walk is too large, the few triplets about its two ends alone say so.
    """
    breaks: dict[str, list[bool]] = {}
    for row in triplets:
        if row.compares_size:
            breaks.setdefault(row.names[1], []).append(row.breaks)
    return tuple(sorted(name for name, rows in breaks.items() if 2 * sum(rows) > len(rows)))


def model_triplets(model: Any, database: str) -> list[Triplet]:
    """Triplets of placed frames with matches in common, by the verified matches of a database.

    Each frame is the middle of triplets with the frames before and after it and with those that it shares most
    verified matches with. The features that the middle one has in common with both others are triangulated from the
    three views with the poses of the model; what is left over is the triplet's residual. A mapper drops matches that
    contradict its model, so that the residuals of what it keeps are small in a wrong model, too; these are all matches.

    model : a `pycolmap.Reconstruction`.
    """
    with pycolmap.Database.open(database) as opened:
        names = {image.image_id: image.name for image in opened.read_all_images()}
        posed = {image.name: image for image in model.images.values() if image.has_pose}
        ids = [image_id for image_id in sorted(names, key=lambda key: names[key]) if names[image_id] in posed]
        pairs, counts = opened.read_two_view_geometry_num_inliers()
        known = {}
        for pair, count in zip(pairs, counts, strict=True):
            first, second = pycolmap.pair_id_to_image_pair(pair)
            if count >= 2 * LEAST_COMMON and names[first] in posed and names[second] in posed:
                known[first, second] = count
        rays = {key: _rays(model, posed[names[key]], np.asarray(opened.read_keypoints(key))) for key in ids}
        triplets = []
        for a, b, c in _chosen_triples(ids, known):
            features = _common_features(opened, a, b, c)
            if len(features) < LEAST_COMMON:
                continue
            poses = np.array([posed[names[key]].cam_from_world().matrix() for key in (a, b, c)])
            seen = np.stack([rays[key][rows] for key, rows in zip((a, b, c), features.T, strict=True)], axis=1)
            seen = seen[np.isfinite(seen).all(axis=(1, 2))]
            angles = triplet_residuals(poses, seen)
            camera = model.cameras[posed[names[b]].camera_id]
            focal = camera.params[0] / max(1.0, max(camera.width, camera.height) / FEATURE_SIDE)
            stretch, noise = triplet_stretch(poses, seen, LEAST_PARALLAX_PX / focal)
            residual = float(np.median(angles) * focal)
            triplets.append(Triplet((names[a], names[b], names[c]), len(angles), residual, stretch, noise))
    return triplets


def triplet_residuals(poses: FloatArray, rays: FloatArray) -> FloatArray:
    """(n,) largest angle in radians between a feature's ray and the direction of its point, over its views.

    poses : (k, 3, 4) from the world to each camera; rays : (n, k, 3) unit vectors of the cameras. A point is the least
    squares solution of ray x (R X + t w) = 0 over all views, which also holds points at infinity.
    """
    if not len(rays):
        return np.zeros(0)
    x, y, z = np.moveaxis(rays, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2)
    centre = -np.einsum("kji,kj->ki", poses[:, :, :3], poses[:, :, 3]).mean(axis=0)
    shift = poses[:, :, :3] @ centre + poses[:, :, 3]  # the origin among the cameras, their distance the unit
    unit = max(float(np.linalg.norm(shift, axis=1).max()), 1e-12)
    moved = np.concatenate([poses[:, :, :3], (shift / unit)[:, :, None]], axis=2)
    rows = np.einsum("nkij,kjl->nkil", cross, moved).reshape(len(rays), -1, 4)
    point = np.linalg.svd(rows)[2][:, -1]  # (n, 4)
    seen = np.einsum("kij,nj->nki", moved, point)
    seen *= np.where(np.einsum("nki,nki->n", seen, rays) < 0, -1.0, 1.0)[:, None, None]
    seen /= np.maximum(np.linalg.norm(seen, axis=2, keepdims=True), 1e-12)
    return np.asarray(2 * np.arcsin(np.clip(np.linalg.norm(seen - rays, axis=2) / 2, 0, 1)).max(axis=1))


def triplet_stretch(poses: FloatArray, rays: FloatArray, least_parallax: float) -> tuple[float, float]:
    """Logarithm of the factor between depths of features by frames two and three and by frames one and two; its noise.

    poses : (3, 3, 4); rays : (n, 3, 3), as for `triplet_residuals`; least_parallax : radians. The noise, three standard
    errors of the median, is taken off; 0 with infinite noise where too few features move enough.
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
        depths.append(np.where((depth > 0) & (sine2 > np.sin(least_parallax) ** 2), depth, np.nan))
    ratio = np.log(depths[1] / depths[0])
    ratio = ratio[np.isfinite(ratio)]
    if len(ratio) < LEAST_DEPTHS:
        return 0.0, np.inf
    middle = float(np.median(ratio))
    noise = 3 * 1.4826 * float(np.median(np.abs(ratio - middle))) / np.sqrt(len(ratio))
    return float(np.sign(middle) * max(abs(middle) - noise, 0.0)), float(noise)


def _chosen_triples(ids: list[int], known: dict[tuple[int, int], int]) -> list[tuple[int, int, int]]:
    """Triples (a, b, c) of frames, b the middle one, whose pairs (a, b) and (b, c) are known; ids : in order."""
    near: dict[int, dict[int, int]] = {key: {} for key in ids}
    for (a, b), count in known.items():
        near[a][b] = near[b][a] = count
    chosen = []
    for place, b in enumerate(ids):
        strongest = sorted(near[b], key=lambda key: (-near[b][key], key))[:STRONGEST]
        pairs = {(a, c) for k, a in enumerate(strongest) for c in strongest[k + 1 :]}
        for step in STEPS:
            if step <= place < len(ids) - step:
                before, after = ids[place - step], ids[place + step]
                if {before, after} <= near[b].keys():
                    pairs = {pair for pair in pairs if set(pair) != {before, after}} | {(before, after)}
        chosen += [(a, b, c) for a, c in sorted(pairs)]
    return chosen


def _common_features(database: Any, a: int, b: int, c: int) -> IntArray:
    """(n, 3) numbers of the features that the verified matches of (a, b) and of (b, c) share."""
    first, second = _matches(database, a, b), _matches(database, c, b)
    common, one, two = np.intersect1d(first[:, 1], second[:, 1], return_indices=True)
    rows = np.column_stack([first[one, 0], common, second[two, 0]]).astype(np.int64)
    return rows[:: max(1, len(rows) // MOST_COMMON)]


def _matches(database: Any, one: int, two: int) -> IntArray:
    """(m, 2) verified matches, features of `one` first."""
    return np.asarray(database.read_two_view_geometry(one, two).inlier_matches, dtype=np.int64).reshape(-1, 2)


def _rays(model: Any, image: Any, keypoints: FloatArray) -> FloatArray:
    """(n, 3) unit rays of the features (n, 2 or more) of a placed frame."""
    plane = np.asarray(model.cameras[image.camera_id].cam_from_img(keypoints[:, :2].astype(np.float64)))
    rays = np.column_stack([plane, np.ones(len(plane))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
