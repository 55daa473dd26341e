"""Sample the images of a reconstruction as directions from a position: the colours that light comes from.

The depth of the nearest points of the cloud is used, so that the direction of a wall at two metres has the correct
parallax. The sky is infinitely far, and the support below an object is read from the closest images.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import pixels_in_view
from estimator.projection.visibility import project_unoccluded
from insertion.colour import luminance, srgb_to_linear
from insertion.footage.footage import SceneImages
from insertion.light.environment_map import HEIGHT, MIRROR, WIDTH, enlarged_map, map_directions
from insertion.scene.camera_rays import camera_rays
from insertion.scene.point_cloud import ColouredPoints, evenly_spaced
from metric_base.arrays import BoolArray, FloatArray

#: Minimum distance of a pixel of the sky from the points of the cloud, in pixels at an image width of 640.
MIN_SKY_DISTANCE_PX = 12.0
#: Maximum ratio of red to blue in an unclipped pixel of the sky.
MAX_SKY_RED_RATIO = 1.05
#: Minimum luminance of an unclipped pixel of the sky.
MIN_SKY_LUMINANCE = 0.15
#: Minimum linear value of a clipped pixel of the sky.
MIN_CLIPPED_SKY = 0.9
#: Maximum number of images.
MAX_IMAGES = 24
#: Minimum distance between sampled pixels, and maximum number of samples along a row of an image.
PIXEL_STEP, MAX_SAMPLES_PER_ROW = 6, 160
#: Radius around a position outdoors in which the depth of the cloud is replaced by the ground, in camera heights.
NEAR_CAMERA_HEIGHTS = 1.5
#: Minimum sine of the angle below the horizon of directions to the support, up to about 2.5 heights of the object from
#: its foot, and number of images whose median is its colour, so that an occluder in one of them is ignored.
MIN_SUPPORT_SINE, N_SUPPORT_IMAGES = 0.2, 3
#: Standard deviation of the smoothing of sharp reflections, in their cells, and range of their ratio to the map.
MIRROR_SIGMA, MIRROR_RANGE = 0.7, (0.1, 10.0)


@dataclass(frozen=True, slots=True, eq=False)
class DirectionSamples:
    """Pixels of the images as directions from a position."""

    directions: FloatArray  #: (n, 3) unit vectors on the axes of the environment
    colours: NDArray[np.float32]  #: (n, 3) linear
    sky: BoolArray  #: (n,) pixels of the sky


def sky_pixels(colours: NDArray[np.float32], rise: FloatArray, distance_px: FloatArray) -> BoolArray:
    """Return which pixels show the sky.

    They are above the horizon, far from the points of the cloud, and either clipped or neither red nor dark.

    Parameters
    ----------
    colours : (..., 3) ndarray of float32
        Linear colours.
    rise : (...) ndarray of float
        Upward component of the rays.
    distance_px : (...) ndarray of float
        Distance to the nearest point of the cloud, in pixels at an image width of 640.
    """
    is_blue = colours[..., 0] <= MAX_SKY_RED_RATIO * colours[..., 2]
    is_bright = is_blue & (luminance(colours) > MIN_SKY_LUMINANCE)
    is_clipped = colours.max(axis=-1) > MIN_CLIPPED_SKY
    return np.asarray((rise > 0) & (distance_px > MIN_SKY_DISTANCE_PX) & (is_bright | is_clipped))


def direction_samples(
    centre: FloatArray, basis: FloatArray, cloud: ColouredPoints, images: SceneImages, ground: float | None = None
) -> DirectionSamples:
    """Return the pixels of the images as directions from a position.

    Parameters
    ----------
    centre : (3,) ndarray of float
        The position.
    basis : (3, 3) ndarray of float
        Axes of the directions.
    ground : float, optional
        Height of the ground outdoors along basis[2]. Pixels without a nearby point of the cloud show the ground or are
        unknown, and so do pixels close to the position, because the points of a bare path may float above it.
    """
    parts = []
    for eye, rays, colours, cloud_depth, distance in pixel_samples(cloud, images):
        depth = cloud_depth
        sky = sky_pixels(colours, rays @ basis[2], distance)
        if ground is not None:
            camera_height = float(eye @ basis[2]) - ground
            is_near = np.linalg.norm(rays * depth[:, None] + eye - centre, axis=1) < NEAR_CAMERA_HEIGHTS * camera_height
            ground_depth = -camera_height / (rays @ basis[2])
            on_ground = is_near | (distance > MIN_SKY_DISTANCE_PX)
            depth = np.where(on_ground, np.where(ground_depth > 0, ground_depth, np.nan), depth)
        away = np.where(sky[:, None], rays, rays * depth[:, None] + eye - centre)  # the sky is infinitely far
        away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        is_valid = colours.any(axis=1) & np.isfinite(away[:, 0])  # undistorted images have a black border
        parts.append((away[is_valid] @ basis.T, colours[is_valid], sky[is_valid]))
    return DirectionSamples(*(np.concatenate(part) for part in zip(*parts, strict=True)))


@lru_cache(maxsize=2)
def pixel_samples(
    cloud: ColouredPoints, images: SceneImages
) -> list[tuple[FloatArray, FloatArray, NDArray[np.float32], FloatArray, FloatArray]]:
    """Return sampled pixels of each image, which all positions in a scene share.

    Returns
    -------
    list of tuple
        Centre (3,) of the camera; rays (n, 3) in the scene, of length 1 along the optical axis; linear colours (n, 3);
        depth (n,) of the nearest point of the cloud in the image; its distance (n,) in pixels at an image width of 640.
    """
    from scipy.spatial import cKDTree

    samples = []
    thinned = cloud.points[:: max(1, len(cloud.points) // 20_000)]
    for row in evenly_spaced(images.rows, MAX_IMAGES):
        view = images.scene.views[row]
        step = max(PIXEL_STEP, round(view.camera.width / MAX_SAMPLES_PER_ROW))
        sampled = (slice(step // 2, None, step),) * 2
        rays = camera_rays(view.camera)[sampled]
        sight = project_unoccluded(view, thinned)
        if len(sight.pixels):
            y, x = np.indices(rays.shape[:2]) * step + step // 2
            distance, nearest = cKDTree(sight.pixels).query(np.column_stack([x.ravel(), y.ravel()]))
            depth = sight.depths[nearest]
        else:  # no point: the extent of the cloud
            depth = np.full(rays[..., 0].size, float(np.linalg.norm(np.ptp(cloud.points, axis=0))))
            distance = np.full(rays[..., 0].size, np.inf)
        in_scene = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1).reshape(-1, 3) @ view.rotation
        colours = srgb_to_linear(images.image(row)[sampled]).reshape(-1, 3)
        samples.append((view.centre, in_scene, colours, depth, distance * 640 / view.camera.width))
    return samples


def with_support(
    samples: DirectionSamples, centre: FloatArray, position: FloatArray, basis: FloatArray, images: SceneImages
) -> DirectionSamples:
    """Replace samples in steep directions downwards by the support in the closest images, one per cell of the mirrors.

    Pixels as directions would leave gaps close to a position, and show what the support hides.

    Parameters
    ----------
    centre, position : (3,) ndarray of float
        Centre of the directions, and the position on the support below it.
    """
    directions = map_directions(MIRROR * HEIGHT, MIRROR * WIDTH).reshape(-1, 3)
    directions = directions[directions[:, 2] < -MIN_SUPPORT_SINE]
    places = centre - directions @ basis * ((centre - position) @ basis[2] / directions[:, 2:])
    views = images.scene.views
    closest = sorted(images.rows, key=lambda row: float(np.linalg.norm(views[row].centre - position)))
    seen = np.full((N_SUPPORT_IMAGES, len(places), 3), np.nan, np.float32)
    for colours, row in zip(seen, closest, strict=False):
        pixels, _ = pixels_in_view(views[row], places)
        inside = np.flatnonzero(np.isfinite(pixels[:, 0]))
        columns, rows = pixels[inside].astype(np.int64).T
        colours[inside] = srgb_to_linear(images.image(row)[rows, columns])
    known = np.isfinite(seen[..., 0]).any(axis=0)
    if not known.any():
        return samples
    keep = samples.directions[:, 2] >= -MIN_SUPPORT_SINE
    return DirectionSamples(
        np.concatenate([samples.directions[keep], directions[known]]),
        np.concatenate([samples.colours[keep], np.nanmedian(seen[:, known], axis=0)]),
        np.concatenate([samples.sky[keep], np.zeros(int(known.sum()), dtype=bool)]),
    )


def average_by_direction(
    samples: DirectionSamples, height: int = HEIGHT, width: int = WIDTH
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Average samples over the cells of a map.

    Returns
    -------
    radiance : (h, w, 3) ndarray of float
        Mean linear colour.
    coverage : (h, w) ndarray of float
        0 without samples, 1 for two or more.
    sky : (h, w) ndarray of float
        Fraction of the samples that show the sky.
    """
    polar = np.arccos(np.clip(samples.directions[:, 2], -1, 1))
    azimuth = np.arctan2(samples.directions[:, 1], samples.directions[:, 0])
    row = np.minimum((polar / np.pi * height).astype(np.int64), height - 1)
    column = np.minimum(((azimuth / (2 * np.pi) + 0.5) * width).astype(np.int64), width - 1)
    cell = row * width + column
    weights = (np.ones(len(cell)), samples.sky.astype(float))
    count, sky = (np.bincount(cell, each, height * width).reshape(height, width).astype(float) for each in weights)
    sums = [np.bincount(cell, samples.colours[:, c].astype(float), height * width) for c in range(3)]
    total = np.stack(sums, axis=-1).reshape(height, width, 3)
    gain = 1 / np.maximum(count, 1e-6)
    return total * gain[..., None], np.clip(count / 2.0, 0.0, 1.0), sky * gain


def mirror_detail(samples: DirectionSamples, filled: FloatArray) -> NDArray[np.float32]:
    """Return the ratio (MIRROR * h, MIRROR * w, 3) of samples to a complete map (h, w, 3); 1 without samples."""
    import cv2

    radiance, coverage, _ = average_by_direction(samples, MIRROR * HEIGHT, MIRROR * WIDTH)
    summed = np.dstack([radiance * coverage[..., None], coverage]).astype(np.float32)
    summed = cv2.GaussianBlur(summed, (0, 0), MIRROR_SIGMA)  # the images leave single cells without a sample
    ratio = summed[..., :3] / np.maximum(summed[..., 3:], 1e-6) / np.maximum(enlarged_map(filled, MIRROR), 1e-3)
    known = np.minimum(2 * summed[..., 3:], 1)
    return np.asarray(1 + known * (np.clip(ratio, *MIRROR_RANGE) - 1), dtype=np.float32)
