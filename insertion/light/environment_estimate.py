"""Estimate the environment map at a position from the images of the reconstruction.

Each image gives the direction of pixels from the position (`direction_samples`). Directions that no image shows, mainly
those of the ceiling and its lamps, are filled from the border of the visible ones. Indoors, their colour makes a white
surface that faces up as white as white surfaces in the images, and neutral if there are none: cameras balance white.

1. In a room with a fitted light, the filled part is scaled to the brightness that the shading of the planes requires,
   and the lamps are added as soft discs.
2. Without a fitted light, a white surface has the luminance of the brightest ordinary surfaces, and most of the missing
   light comes from a lobe towards the expected lamp, high above the centre of the room.
3. Outdoors, the sky is infinitely far: a pixel of it has the same direction at every position. Unseen directions above
   the horizon are sky of the same brightness as the visible sky at their elevation. Images contain neither the sun nor
   an unclipped bright sky: the total is determined by the ground, whose albedo is assumed, and is grey, because
   cameras balance white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.planes import level_basis
from insertion.colour import luminance
from insertion.footage.footage import SceneImages
from insertion.light.direction_samples import (
    MAX_IMAGES,
    PIXEL_STEP,
    average_by_direction,
    direction_samples,
    mirror_detail,
    with_support,
)
from insertion.light.environment_map import (
    HEIGHT,
    Environment,
    SphereLights,
    map_directions,
    solid_angles,
)
from insertion.light.lamp_fit import Lamp, RoomLight
from insertion.light.light_samples import LAMP_SIGMA
from insertion.scene.camera_rays import camera_rays
from insertion.scene.occupancy import Occupancy
from insertion.scene.point_cloud import ColouredPoints, evenly_spaced
from metric_base.arrays import FloatArray

#: Minimum fraction of pixels of the sky in an outdoor scene. Set on two rooms (none) and two streets (a sixth).
MIN_SKY_FRACTION = 0.05
#: Width of the border around objects in which unseen directions belong to the object, in cells of the map.
OBJECT_BORDER_CELLS = 4
#: Standard deviation of the smoothing of the sky over elevation, in rows of the map.
ELEVATION_SIGMA = 6.0
#: Albedo of the ground outdoors. Grass, asphalt, concrete and earth reflect 0.1 to 0.35.
GROUND_ALBEDO = 0.25
#: Fraction of the light on the ground that comes from an invisible sky if there is a sun: 0.15 to 0.3 for a clear sky.
SKY_FRACTION = 0.25
#: Minimum and maximum factor of the sky's brightness over that in the images.
SKY_GAIN_RANGE = (0.3, 8.0)
#: Fraction of pixels above the brightest ordinary surfaces: lamps, windows, highlights.
HIGHLIGHT_FRACTION = 0.03
#: Albedo of a white surface. It determines the amount of light without a fitted light.
WHITE_ALBEDO = 0.65
#: Maximum absolute log ratio of red or blue to green of a white or grey surface in the images.
MAX_WHITE_LOG_RATIO = 0.25
#: Minimum luminance of such a surface, relative to the brightest ordinary surfaces; darker ones have coloured noise.
MIN_WHITE_RATIO = 0.4
#: Minimum fraction of the pixels that show such surfaces.
MIN_WHITE_FRACTION = 0.01
#: Minimum and maximum factor on a channel of the unseen light.
WHITE_GAIN_RANGE = (0.4, 2.5)
#: Fraction of the unseen irradiance that comes from the expected lamp.
LAMP_FRACTION = 0.6
#: Exponent of the cosine lobe of the expected lamp, about 25 degrees wide.
LAMP_EXPONENT = 12
#: Minimum and maximum factor of the unseen part over the filled one.
UNSEEN_GAIN_RANGE = (0.3, 8.0)
#: Minimum sRGB-linear value of a clipped cell, whose lamp is brighter by an unknown factor.
MIN_CLIPPED = 0.96
#: Factor on the radiance of clipped cells.
CLIPPED_GAIN = 6.0
#: Diameter of the sun in radians.
SUN_DIAMETER = 0.0093
#: Distance of the sun, in heights of the object: its light is parallel.
SUN_DISTANCE_HEIGHTS = 1e4
#: Number of sample heights on the object, for the visibility of a lamp.
N_HEIGHT_SAMPLES = 6
#: Number of sample points on a lamp, for its visibility.
N_LAMP_SAMPLES = 4


@dataclass(frozen=True, slots=True, eq=False)
class OutdoorLight:
    """The light of a scene under the sky."""

    sun: FloatArray | None  #: (3,) unit vector towards the sun; None if no shadow determines it
    occupancy: Occupancy | None = None  #: the objects that may be in front of the sun


def environment_at(
    position: FloatArray,
    height: float,
    basis: FloatArray,
    cloud: ColouredPoints,
    images: SceneImages,
    light: RoomLight | OutdoorLight | None = None,
) -> Environment:
    """Estimate the environment map centred on an object.

    Parameters
    ----------
    position : (3,) ndarray of float
        Bottom centre of the object in the scene.
    height : float
        Height of the object, in scene units.
    basis : (3, 3) ndarray of float
        Axes of the map as rows: two horizontal ones and up.
    cloud : ColouredPoints
        Points of the scene.
    images : SceneImages
        Images of the reconstruction.
    light : RoomLight or OutdoorLight, optional
        Fitted light of the scene.
    """
    centre = position + 0.5 * height * basis[2]
    ground = float(position @ basis[2]) if isinstance(light, OutdoorLight) else None
    samples = direction_samples(centre, basis, cloud, images, ground)
    complete_samples = with_support(samples, centre, position, basis, images)
    radiance, coverage, sky = average_by_direction(complete_samples)
    detail = mirror_detail(complete_samples, fill_unseen(radiance, coverage))
    if isinstance(light, OutdoorLight):
        below = samples.directions[:, 2] < -0.5
        ground_pixels = samples.colours[below if below.any() else ~samples.sky]
        ground_luminance = float(np.median(luminance(ground_pixels)))
        sun = None if light.sun is None else basis @ light.sun
        complete, known, sun_power = sky_light(radiance, coverage, sky, ground_luminance, sun)
        filled = fill_unseen(complete, known)
        if light.sun is not None and light.occupancy is not None and sun_power.any():
            distance = SUN_DISTANCE_HEIGHTS * height
            size, power = np.array([SUN_DIAMETER * distance]), sun_power[None] * distance**2
            lamp = SphereLights((centre + distance * light.sun)[None], power, size, centre, light.occupancy)
            fraction = reaching_fraction(lamp, light.occupancy, position, basis[2], height)
            shaded = add_lamps(filled, coverage, basis, replace(lamp, power=power * fraction[:, None]))
            return replace(shaded, lamps=lamp, detail=detail)
    elif light is None:
        is_clipped = radiance.max(axis=-1, keepdims=True) > MIN_CLIPPED
        radiance = radiance * (1 + (CLIPPED_GAIN - 1) * is_clipped)
        white = float(np.quantile(luminance(samples.colours), 1 - HIGHLIGHT_FRACTION))
        lamp_direction = expected_lamp_direction(centre, basis, cloud)
        filled = raise_ceiling(fill_unseen(radiance, coverage), coverage, white, lamp_direction)
        filled, _ = balance_white(filled, coverage, white_colour(samples.colours))
    else:
        ambient = scale_unseen(fill_unseen(radiance, coverage), coverage, light.unseen)
        lamps = lamp_spheres(light.lamps, centre)
        if light.occupancy is not None:
            fraction = reaching_fraction(lamps, light.occupancy, position, basis[2], height)
            lamps = replace(lamps, power=lamps.power * fraction[:, None])
        away = lamps.positions - centre
        cosine = np.maximum(away @ basis[2], 0.0) / np.maximum(np.linalg.norm(away, axis=1), 1e-9) ** 3
        ambient, gain = balance_white(ambient, coverage, white_colour(samples.colours), cosine @ lamps.power)
        lamps = replace(lamps, power=lamps.power * gain)
        return replace(add_lamps(ambient, coverage, basis, lamps), detail=detail)
    return Environment(filled.astype(np.float32), basis, coverage.astype(np.float32), detail=detail)


def is_outdoors(cloud: ColouredPoints, images: SceneImages, up: FloatArray) -> bool:
    """Return whether enough pixels of the images show the sky; `up` is a unit vector (3,)."""
    samples = direction_samples(cloud.points.mean(axis=0), level_basis(up), cloud, images)
    return bool(samples.sky.mean() >= MIN_SKY_FRACTION)


def looks_down(images: SceneImages, up: FloatArray) -> bool:
    """Return whether too few pixels are above the horizon to show a sky; `up` is a unit vector (3,)."""
    views = [images.scene.views[row] for row in evenly_spaced(images.rows, MAX_IMAGES)]
    above = [
        np.mean(
            camera_rays(view.camera)[::PIXEL_STEP, ::PIXEL_STEP] @ (view.rotation @ up)[:2] > -view.rotation[2] @ up
        )
        for view in views
    ]
    return float(np.mean(above)) < MIN_SKY_FRACTION


def sky_light(
    radiance: FloatArray, coverage: FloatArray, sky: FloatArray, ground: float, sun: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Complete the sky of an environment and balance it with the brightness of the ground.

    Parameters
    ----------
    radiance : (h, w, 3) ndarray of float
        Mean radiance by direction.
    coverage : (h, w) ndarray of float
        How well each direction is known, 0 to 1.
    sky : (h, w) ndarray of float
        Fraction of the samples of a direction that show the sky.
    ground : float
        Luminance of the ground in the images.
    sun : (3,) ndarray of float or None
        Direction of the sun on the axes of the map.

    Returns
    -------
    radiance : (h, w, 3) ndarray of float
        Radiance with the complete sky.
    known : (h, w) ndarray of float
        Coverage with the completed directions.
    sun_power : (3,) ndarray of float
        Irradiance across the light of the sun, if nothing occludes it; 0 if its direction is unknown. The sky then is
        brighter.
    """
    from scipy.ndimage import distance_transform_edt

    up = map_directions()[..., 2]
    is_object = np.tile((coverage > 0) & (sky < 0.5) & (up > 0), (1, 3))  # three periods of the azimuth
    near_object = distance_transform_edt(~is_object)[:, up.shape[1] : 2 * up.shape[1]] <= OBJECT_BORDER_CELLS
    is_filled = (up > 0) & (coverage == 0) & ~near_object
    sky_fraction = np.where(coverage > 0, sky, 1.0 * is_filled)[..., None]
    is_sky = coverage * (sky >= 0.5)
    unseen_sky = np.full((HEIGHT, 1, 3), SKY_FRACTION * ground / GROUND_ALBEDO)
    by_elevation = _mean_by_elevation(radiance, is_sky)[:, None] if is_sky.any() else unseen_sky
    complete = np.where(is_filled[..., None], by_elevation, radiance)
    is_below = (up < 0) & (coverage == 0)
    if (coverage[up < 0] > 0).any():
        below_mean = _mean_by_elevation(radiance, coverage * (up < 0))[:, None]
        complete = np.where(is_below[..., None], below_mean, complete)
    weight = (np.maximum(up, 0.0) * solid_angles()[:, None])[..., None]
    from_sky, other = ((weight * complete * part).sum(axis=(0, 1)) for part in (sky_fraction, 1 - sky_fraction))
    target = max(np.pi * ground / GROUND_ALBEDO, float(luminance(from_sky + other)))  # grey: cameras balance white
    known = np.where(is_filled | is_below, 1.0, coverage)
    if sun is not None:
        return complete, known, np.maximum(target - from_sky - other, 0.0) / sun[2]
    gain = np.clip((target - other) / np.maximum(from_sky, 1e-9), *SKY_GAIN_RANGE)
    return complete * (1 + (gain - 1) * sky_fraction), known, np.zeros(3)


def _mean_by_elevation(radiance: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the weighted mean (h, 3) of each row of a map (h, w, 3), smoothed over rows; `weight` is (h, w)."""
    from scipy.ndimage import gaussian_filter1d

    sums = gaussian_filter1d(np.einsum("hw,hwc->hc", weight, radiance), ELEVATION_SIGMA, axis=0, mode="constant")
    counts = gaussian_filter1d(weight.sum(axis=1), ELEVATION_SIGMA, mode="constant")
    row = np.arange(HEIGHT)
    known = row[counts > 1e-3 * max(float(counts.max()), 1e-12)]
    nearest = known[np.abs(row[:, None] - known).argmin(axis=1)]  # the zenith is as bright as the highest known row
    return np.asarray(sums[nearest] / counts[nearest, None])


def fill_unseen(radiance: FloatArray, coverage: FloatArray) -> FloatArray:
    """Fill unseen directions from increasingly large neighbourhoods of the seen ones (push-pull).

    Parameters
    ----------
    radiance : (h, w, 3) ndarray of float
        Radiance by direction.
    coverage : (h, w) ndarray of float
        How well each direction is known, 0 to 1.
    """
    from scipy.ndimage import gaussian_filter

    area = solid_angles()[:, None]
    result, known = radiance * coverage[..., None], coverage.copy()
    weighted = np.dstack([radiance, np.ones(coverage.shape)]) * (coverage * area)[..., None]
    for sigma in (1.0, 2.0, 4.0, 8.0, 16.0, 48.0):
        sums = gaussian_filter(weighted, (sigma, sigma, 0), mode=("nearest", "wrap", "nearest"))
        colour = sums[..., :3] / np.maximum(sums[..., 3:], 1e-12)
        fraction = np.clip(sums[..., 3] / area * 4, 0, 1) * (1 - known)
        result += fraction[..., None] * colour
        known += fraction
    return np.asarray(result / np.maximum(known, 1e-6)[..., None])


def expected_lamp_direction(centre: FloatArray, basis: FloatArray, cloud: ColouredPoints) -> FloatArray:
    """Return the unit direction (3,) on the axes `basis` from `centre` to high above the centre of the room."""
    local = (cloud.points - centre) @ basis.T
    low, high = np.percentile(local, [5, 95], axis=0)
    lamp = np.append((low + high)[:2] / 2, max(float(high[2]), 0.25 * float((high - low)[:2].max())))
    return np.asarray(lamp / max(float(np.linalg.norm(lamp)), 1e-12))


def raise_ceiling(filled: FloatArray, coverage: FloatArray, white: float, lamp: FloatArray) -> FloatArray:
    """Scale the unseen upper part so that a white surface has the luminance `white`: E(up) = pi * white / albedo.

    `LAMP_FRACTION` of the unseen irradiance becomes a grey lobe about the unit direction `lamp` (3,). `filled`
    (h, w, 3) and `coverage` (h, w) are those of `scale_unseen`.
    """
    directions = map_directions()
    weight = np.maximum(directions[..., 2], 0.0) * solid_angles()[:, None]
    hidden = (1 - coverage) * (weight > 0)
    lobe = hidden * np.maximum(directions @ lamp, 0.0) ** LAMP_EXPONENT
    total = float((weight * lobe).sum())
    if total <= 1e-9:
        return filled
    seen = float((weight * (1 - hidden) * luminance(filled)).sum())
    required = (np.pi * white / WHITE_ALBEDO - seen) / float((weight * hidden).sum())
    scaled = scale_unseen(filled, coverage, required)
    unseen = float((weight * hidden * luminance(scaled)).sum())
    lobe *= LAMP_FRACTION * unseen / total
    return np.asarray(scaled * (1 - LAMP_FRACTION * hidden)[..., None] + lobe[..., None])


def white_colour(colours: NDArray[np.float32]) -> FloatArray:
    """Return the colour (3,) of white and grey surfaces in the images, of luminance 1; (1, 1, 1) without such surfaces.

    Parameters
    ----------
    colours : (n, 3) ndarray of float32
        Linear colours of the pixels.
    """
    brightness = luminance(colours)
    white = float(np.quantile(brightness, 1 - HIGHLIGHT_FRACTION))
    is_valid = (colours.max(axis=1) < MIN_CLIPPED) & (brightness > MIN_WHITE_RATIO * white) & (colours > 0).all(axis=1)
    log_ratio = np.log(colours[is_valid] / colours[is_valid, 1:2])
    log_ratio = log_ratio[np.abs(log_ratio).max(axis=1) < MAX_WHITE_LOG_RATIO]
    if len(log_ratio) < MIN_WHITE_FRACTION * len(colours):
        return np.ones(3)
    colour = np.exp(np.median(log_ratio, axis=0))
    return np.asarray(colour / float(luminance(colour)), dtype=np.float64)


def balance_white(
    filled: FloatArray, coverage: FloatArray, white: FloatArray, lamps: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Give the unseen light the colour with which a white surface that faces up has the colour `white`.

    Parameters
    ----------
    filled, coverage : (h, w, 3) and (h, w) ndarray of float
        Those of `scale_unseen`.
    white : (3,) ndarray of float
        Colour of luminance 1.
    lamps : (3,) ndarray of float or 0
        Irradiance of the lamps on this surface.

    Returns
    -------
    radiance : (h, w, 3) ndarray of float
        The radiance, of equal luminance in every direction if no channel is at its limit.
    gain : (3,) ndarray of float
        Factor on the lamps, as on the unseen light.
    """
    hidden = (1 - coverage)[..., None]
    weight = (np.maximum(map_directions()[..., 2], 0.0) * solid_angles()[:, None])[..., None]
    grey = hidden * luminance(filled)[..., None]
    seen = (weight * (1 - hidden) * filled).sum(axis=(0, 1))
    rest = (weight * grey).sum(axis=(0, 1)) + lamps
    gain = (float(luminance(seen + rest)) * white - seen) / np.maximum(rest, 1e-9)
    gain = np.clip(gain, *WHITE_GAIN_RANGE)
    return (1 - hidden) * filled + grey * gain, gain


def scale_unseen(filled: FloatArray, coverage: FloatArray, radiance: float) -> FloatArray:
    """Scale the unseen upper part so that its mean luminance, weighted by the cosine with up, is `radiance`.

    Parameters
    ----------
    filled : (h, w, 3) ndarray of float
        Filled radiance.
    coverage : (h, w) ndarray of float
        How well each direction is known, 0 to 1.
    """
    rise = map_directions()[..., 2]
    hidden = (1 - coverage) * (rise > 0)
    weight = hidden * np.maximum(rise, 0.0) * solid_angles()[:, None]
    unseen = float((weight * luminance(filled)).sum())
    if unseen <= 1e-9:
        return filled
    gain = float(np.clip(radiance * weight.sum() / unseen, *UNSEEN_GAIN_RANGE))
    return np.asarray(filled * (1 + (gain - 1) * hidden)[..., None])


def lamp_spheres(lamps: Sequence[Lamp], centre: FloatArray) -> SphereLights:
    """Return the candidate positions of lamps with the power that they emit towards `centre` (3,)."""
    powers = []
    for lamp in lamps:
        away = lamp.positions - centre
        cosine = np.maximum(-(away * lamp.facing).sum(axis=1) / np.maximum(np.linalg.norm(away, axis=1), 1e-9), 0.0)
        power = lamp.weights * lamp.strengths * np.where(lamp.facing.any(axis=1), cosine, 1.0)
        powers.append(power[:, None] * lamp.colour)
    sizes = [np.full(len(lamp.positions), lamp.size) for lamp in lamps]
    positions = np.concatenate([lamp.positions for lamp in lamps])
    return SphereLights(positions, np.concatenate(powers), np.concatenate(sizes), centre)


def reaching_fraction(
    lamps: SphereLights, occupancy: Occupancy, position: FloatArray, up: FloatArray, height: float
) -> FloatArray:
    """Return the fraction (k,) of the light of each lamp that reaches a vertical line past the occupied cells.

    Parameters
    ----------
    position, up : (3,) ndarray of float
        Lower end of the line, and its unit direction.
    height : float
        Length of the line, in scene units.
    """
    heights = height * (np.arange(N_HEIGHT_SAMPLES) + 0.5) / N_HEIGHT_SAMPLES
    line = position + heights[:, None] * up
    offsets = np.random.default_rng(0).normal(0.0, LAMP_SIGMA, (N_LAMP_SAMPLES, 1, 3)) * lamps.size[:, None]
    ends = (lamps.positions + offsets).reshape(-1, 3)
    is_open = occupancy.is_unobstructed(line, np.tile(up, (N_HEIGHT_SAMPLES, 1)), ends)
    return np.asarray(is_open.reshape(N_LAMP_SAMPLES, -1, N_HEIGHT_SAMPLES).mean(axis=(0, 2)))


def add_lamps(ambient: FloatArray, coverage: FloatArray, basis: FloatArray, lamps: SphereLights) -> Environment:
    """Return the environment of the ambient radiance (h, w, 3) with a soft disc for each lamp; `coverage` is (h, w)."""
    directions, area = map_directions(), solid_angles()[:, None]
    light = np.zeros(ambient.shape)
    away = (lamps.positions - lamps.centre) @ basis.T
    distances = np.maximum(np.linalg.norm(away, axis=1), lamps.size / 2)
    for toward, distance, power, size in zip(away, distances, lamps.power, lamps.size, strict=True):
        cosine = directions @ (toward / distance)
        width = np.arctan(size / 2 / distance)
        lobe = np.exp(-(1 - cosine) / max(1 - np.cos(width), 1e-4))
        light += (lobe / max(float((lobe * area).sum()), 1e-12))[..., None] * power / distance**2
    total, ambient_only = ((ambient + part).astype(np.float32) for part in (light, 0.0))
    return Environment(total, basis, coverage.astype(np.float32), ambient_only, lamps)
