"""The environment at a place, from the pictures.

Each still gives every pixel's direction from the place: by the depth of the cloud where it has points nearby, so that a
wall two metres away shifts as it should. What no picture shows (mostly the ceiling and its lamps) is filled from the
border of what they show, then scaled to the brightness that the shading of the planes asks for; the lamps that it asks
for are added. Without planes, a white surface is as bright as the brightest ordinary surfaces of the
pictures, and most of the unseen light comes from where lamps are: high above the middle of the room.

The light outdoors: which pixels show the sky, what it is where no picture shows it, and what the sun sends.

The sky is infinitely far: a pixel of it says the same direction at every place. What no picture shows of the upper half
is sky as well, as bright as the sky that is seen at its height. Pictures hold neither the sun nor a bright sky. How
much light there is says the ground, which reflects a quarter of it, and its colour is grey: cameras balance white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.planes import level_basis
from estimator.projection.visibility import project_unoccluded
from insertion.colour import luminance, srgb_to_linear
from insertion.footage.footage import Stills
from insertion.light.environment_map import HEIGHT, WIDTH, Environment, LampSpots, map_directions, solid_angles
from insertion.light.lamp_fit import Lamp, Shading
from insertion.light.light_samples import LAMP_SIGMA
from insertion.request import Place
from insertion.scene.camera_rays import camera_rays
from insertion.scene.occupancy import Occupancy
from insertion.scene.point_cloud import Cloud, even_rows
from metric_base.arrays import BoolArray, FloatArray

#: Pixels of the sky have no point of the cloud within so many pixels at a width of 640, rise above the horizon, and are
#: either clipped (of 1) or no redder than this times their blue, and not dark.
FREE_PX, NOT_RED, NOT_DARK = 12.0, 1.05, 0.15
SKY_CLIPPED = 0.9
#: A scene is outdoors if this share of all pixels shows the sky: in the two rooms and two streets that it was set by,
#: none and a sixth.
LEAST_SHARE = 0.05
#: What is not seen within so many cells of what stands there belongs to it; the rest is sky.
BESIDE_CELLS = 4
#: Rows of the environment over which the sky is alike, one sigma.
ALIKE_ROWS = 6.0
#: Ground outdoors (grass, asphalt, concrete, earth) reflects 0.1 to 0.35.
GROUND_ALBEDO = 0.25
#: The sky is at least and at most so many times as bright as the picture holds.
TIMES = (0.3, 8.0)
#: Stills that are looked at, and pixels between samples.
MAX_STILLS, STEP = 24, 6
#: This share of the pixels is brighter than the brightest ordinary surfaces (lamps, windows, highlights).
BRIGHTER_SHARE = 0.03
#: A white surface reflects this, where nothing else says how much light there is.
WHITE_ALBEDO = 0.65
#: This share of the unseen light comes from the lamp, as this power of the cosine about its direction (25 degrees).
LAMP_SHARE, LAMP_POWER = 0.6, 12
#: The unseen part is never darker, and never brighter, than this times the border of what is seen.
UNSEEN = (0.3, 8.0)
#: A value at this level is clipped: the lamp behind it is brighter by an unknown factor.
CLIPPED, CLIPPED_TIMES = 0.96, 6.0
#: Beside a place outdoors is what is nearer than so many heights of the camera over the ground.
BESIDE = 1.5
#: The sun's diameter in radians, and its distance in heights of the object.
SUN_WIDTH, SUN_HEIGHTS = 0.0093, 1e4
#: Places up the object that are asked whether they see a lamp, and points of the lamp.
SEEN_FROM, SPREAD = 6, 4


@dataclass(frozen=True, slots=True, eq=False)
class Outdoors:
    """The light of a place under the sky; sun : (3,) unit vector towards the sun, None where no shadow says where."""

    sun: FloatArray | None


def sky_pixels(colours: NDArray[np.float32], rise: FloatArray, free: FloatArray) -> BoolArray:
    """(...) whether each pixel shows the sky.

    colours : (..., 3) linear; rise : (...) upward component of its unit ray; free : (...) pixels to the nearest point
    of the cloud, at a width of 640.
    """
    bright = (colours[..., 0] <= NOT_RED * colours[..., 2]) & (luminance(colours) > NOT_DARK)
    return np.asarray((rise > 0) & (free > FREE_PX) & (bright | (colours.max(axis=-1) > SKY_CLIPPED)))


def sky_light(
    shown: FloatArray, seen: FloatArray, sky: FloatArray, ground: float, sun: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The light with the whole sky in it: (h, w, 3) radiance, (h, w) how far it is known, (3,) what the sun sends.

    shown : (h, w, 3) radiance by direction; seen : (h, w) how far it is known; sky : (h, w) share of it that is sky;
    ground : luminance of the ground in the pictures; sun : (3,) the way to it. What the sun sends is the irradiance
    across its light, 0 where it is not known, or hidden by what stands there. Without it the sky makes up for it.
    """
    from scipy.ndimage import distance_transform_edt

    directions = map_directions()
    up = directions[..., 2]
    stands = np.tile(
        (seen > 0) & (sky < 0.5) & (up > 0), (1, 3)
    )  # three times around, for the neighbours beyond the edge
    beside = distance_transform_edt(~stands)[:, up.shape[1] : 2 * up.shape[1]] <= BESIDE_CELLS
    filled = (up > 0) & (seen == 0) & ~beside
    of_sky = np.where(seen > 0, sky, 1.0 * filled)[..., None]
    whole = np.where(filled[..., None], _by_height(shown, seen * (sky >= 0.5))[:, None], shown)
    below = (up < 0) & (seen == 0)
    if (seen[up < 0] > 0).any():
        whole = np.where(below[..., None], _by_height(shown, seen * (up < 0))[:, None], whole)
    weight = (np.maximum(up, 0.0) * solid_angles()[:, None])[..., None]
    from_sky, other = ((weight * whole * part).sum(axis=(0, 1)) for part in (of_sky, 1 - of_sky))
    wanted = max(np.pi * ground / GROUND_ALBEDO, float(luminance(from_sky + other)))  # grey: the camera balances white
    known = np.where(filled | below, 1.0, seen)
    if sun is not None and of_sky.ravel()[(directions @ sun).argmax()] >= 0.5:
        return whole, known, np.maximum(wanted - from_sky - other, 0.0) / sun[2]
    times = np.clip((wanted - other) / np.maximum(from_sky, 1e-9), *TIMES)
    return whole * (1 + (times - 1) * of_sky), known, np.zeros(3)


def _by_height(shown: FloatArray, weight: FloatArray) -> FloatArray:
    """(h, 3) mean of a map (h, w, 3) by its rows, smooth over them; weight : (h, w)."""
    from scipy.ndimage import gaussian_filter1d

    sums = gaussian_filter1d(np.einsum("hw,hwc->hc", weight, shown), ALIKE_ROWS, axis=0, mode="constant")
    counts = gaussian_filter1d(weight.sum(axis=1), ALIKE_ROWS, mode="constant")
    row = np.arange(HEIGHT)
    some = row[counts > 1e-3 * max(float(counts.max()), 1e-12)]
    nearest = some[np.abs(row[:, None] - some).argmin(axis=1)]  # the zenith is as bright as the highest that is seen
    return np.asarray(sums[nearest] / counts[nearest, None])


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Directions (n, 3) in the place's basis, linear colours (n, 3), and which of them (n,) show the sky."""

    directions: FloatArray
    colours: NDArray[np.float32]
    sky: BoolArray


def environment_at(
    place: Place, height: float, cloud: Cloud, stills: Stills, shading: Shading | Outdoors | None = None
) -> Environment:
    """The environment around the middle of an object of this height (scene units) at the place."""
    middle = place.position + 0.5 * height * place.basis[2]
    ground = float(place.position @ place.basis[2]) if isinstance(shading, Outdoors) else None
    samples = _samples(middle, place.basis, cloud, stills, ground)
    shown, seen, sky = _shown(samples)
    if isinstance(shading, Outdoors):
        sun = None if shading.sun is None else place.basis @ shading.sun
        whole, known, power = sky_light(shown, seen, sky, _ground_level(samples), sun)
        lit = _fill(whole, known)
        if shading.sun is not None and power.any():
            return _with_lamps(lit, seen, place.basis, _sun_spot(shading.sun, power, middle, height))
    elif shading is None:
        shown = shown * (1 + (CLIPPED_TIMES - 1) * (shown.max(axis=-1, keepdims=True) > CLIPPED))
        toward = _lamp_direction(middle, place.basis, cloud)
        lit = _raise_top(_fill(shown, seen), seen, _white_level(samples), toward)
    else:
        rest = _with_unseen(_fill(shown, seen), seen, shading.unseen)
        spots = _spots(shading.lamps, middle)
        if shading.occupancy is not None:
            share = _share_reaching(spots, shading.occupancy, place, height)
            spots = replace(spots, power=spots.power * share[:, None])
        return _with_lamps(rest, seen, place.basis, spots)
    return Environment(lit.astype(np.float32), place.basis, seen.astype(np.float32))


def shows_sky(cloud: Cloud, stills: Stills, up: FloatArray) -> bool:
    """Whether the pictures are of a place outdoors; up : (3,) unit vector."""
    return bool(_samples(cloud.points.mean(axis=0), level_basis(up), cloud, stills).sky.mean() >= LEAST_SHARE)


def _sun_spot(sun: FloatArray, power: FloatArray, middle: FloatArray, height: float) -> LampSpots:
    """The sun as a lamp so far away that its light is parallel; sun : (3,) the way to it; power : (3,) irradiance."""
    distance = SUN_HEIGHTS * height
    place = middle + distance * sun
    return LampSpots(place[None], power[None] * distance**2, np.array([SUN_WIDTH * distance]), middle)


def _spots(lamps: Sequence[Lamp], middle: FloatArray) -> LampSpots:
    """The lamps' places with what they send towards `middle` (3,)."""
    powers = []
    for lamp in lamps:
        away = lamp.places - middle
        shone = np.maximum(-(away * lamp.facing).sum(axis=1) / np.maximum(np.linalg.norm(away, axis=1), 1e-9), 0.0)
        power = lamp.weights * lamp.strengths * np.where(lamp.facing.any(axis=1), shone, 1.0)
        powers.append(power[:, None] * lamp.colour)
    sizes = [np.full(len(lamp.places), lamp.size) for lamp in lamps]
    places = np.concatenate([lamp.places for lamp in lamps])
    return LampSpots(places, np.concatenate(powers), np.concatenate(sizes), middle)


def _share_reaching(lamps: LampSpots, occupancy: Occupancy, place: Place, height: float) -> FloatArray:
    """(k,) share of the light of each spot that reaches an upright line at the place past what the cloud shows."""
    heights = height * (np.arange(SEEN_FROM) + 0.5) / SEEN_FROM
    line = place.position + heights[:, None] * place.basis[2]
    offsets = np.random.default_rng(0).normal(0.0, LAMP_SIGMA, (SPREAD, 1, 3)) * lamps.size[:, None]
    ends = (lamps.places + offsets).reshape(-1, 3)
    opened = occupancy.open_segments(line, np.tile(place.basis[2], (SEEN_FROM, 1)), ends)
    return np.asarray(opened.reshape(SPREAD, -1, SEEN_FROM).mean(axis=(0, 2)))


def _with_lamps(rest: FloatArray, seen: FloatArray, basis: FloatArray, lamps: LampSpots) -> Environment:
    """The environment of the rest (h, w, 3), of which (h, w) is seen, with a soft disc for each spot of the lamps."""
    directions, area = map_directions(), solid_angles()[:, None]
    light = np.zeros(rest.shape)
    away = (lamps.places - lamps.middle) @ basis.T
    distances = np.maximum(np.linalg.norm(away, axis=1), lamps.size / 2)
    for toward, distance, power, size in zip(away, distances, lamps.power, lamps.size, strict=True):
        cosine = directions @ (toward / distance)
        width = np.arctan(size / 2 / distance)
        lobe = np.exp(-(1 - cosine) / max(1 - np.cos(width), 1e-4))
        light += (lobe / max(float((lobe * area).sum()), 1e-12))[..., None] * power / distance**2
    total, alone = ((rest + more).astype(np.float32) for more in (light, 0.0))
    return Environment(total, basis, seen.astype(np.float32), alone, lamps)


def _shown(samples: _Samples) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(h, w, 3) mean radiance by direction, (h, w) how far it is known, 0 to 1, and (h, w) its share of sky."""
    total, count, sky = _splat(samples)
    times = 1 / np.maximum(count, 1e-6)
    return total * times[..., None], np.clip(count / 2.0, 0.0, 1.0), sky * times


def _samples(
    middle: FloatArray, basis: FloatArray, cloud: Cloud, stills: Stills, ground: float | None = None
) -> _Samples:
    """Directions and colours of what the stills show about `middle` (3,), in the frame `basis` (3, 3).

    ground : the height along basis[2] of the ground outdoors: what no point of the cloud is near to is the ground, or
    not known, and so is what points say to be beside the place, since those of a bare path may float above it.
    """
    parts = []
    for row in even_rows(stills.rows, MAX_STILLS):
        view = stills.scene.views[row]
        rays = camera_rays(view.camera)[STEP // 2 :: STEP, STEP // 2 :: STEP]
        depth, free = (grid.ravel() for grid in _depth_grid(cloud, stills, row, rays.shape[:2]))
        ways = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1).reshape(-1, 3) @ view.rotation
        colours = srgb_to_linear(stills.picture(row)[STEP // 2 :: STEP, STEP // 2 :: STEP]).reshape(-1, 3)
        free *= 640 / view.camera.width
        sky = sky_pixels(colours, ways @ basis[2], free)
        if ground is not None:
            rise = float(view.centre @ basis[2]) - ground
            near = np.linalg.norm(ways * depth[:, None] + view.centre - middle, axis=1) < BESIDE * rise
            level = -rise / (ways @ basis[2])
            depth = np.where(near | (free > FREE_PX), np.where(level > 0, level, np.nan), depth)
        away = np.where(sky[:, None], ways, ways * depth[:, None] + view.centre - middle)
        away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        inside = colours.any(axis=1) & np.isfinite(away[:, 0])  # an undistorted picture has a black edge
        parts.append((away[inside] @ basis.T, colours[inside], sky[inside]))
    return _Samples(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _depth_grid(cloud: Cloud, stills: Stills, row: int, shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """(h, w) depth of each sample, that of the nearest point in the picture, and (h, w) pixels to that point.

    Without any point, the depth is the cloud's own extent.
    """
    from scipy.spatial import cKDTree

    step = max(1, len(cloud.points) // 20_000)
    sight = project_unoccluded(stills.scene.views[row], cloud.points[::step])
    if not len(sight.pixels):
        return np.full(shape, float(np.linalg.norm(np.ptp(cloud.points, axis=0)))), np.full(shape, np.inf)
    y, x = np.indices(shape) * STEP + STEP // 2
    distance, nearest = cKDTree(sight.pixels).query(np.column_stack([x.ravel(), y.ravel()]))
    return np.asarray(sight.depths[nearest].reshape(shape)), np.asarray(distance.reshape(shape))


def _splat(samples: _Samples) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(h, w, 3) sums of colour, (h, w) counts and (h, w) counts of the sky, by direction."""
    polar = np.arccos(np.clip(samples.directions[:, 2], -1, 1))
    turn = np.arctan2(samples.directions[:, 1], samples.directions[:, 0])
    row = np.minimum((polar / np.pi * HEIGHT).astype(np.int64), HEIGHT - 1)
    column = np.minimum(((turn / (2 * np.pi) + 0.5) * WIDTH).astype(np.int64), WIDTH - 1)
    cell = row * WIDTH + column
    weights = (np.ones(len(cell)), samples.sky.astype(float))
    count, sky = (np.bincount(cell, each, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH).astype(float) for each in weights)
    sums = [np.bincount(cell, samples.colours[:, c].astype(float), HEIGHT * WIDTH) for c in range(3)]
    return np.asarray(np.stack(sums, axis=-1).reshape(HEIGHT, WIDTH, 3)), count, sky


def _fill(shown: FloatArray, seen: FloatArray) -> FloatArray:
    """(h, w, 3) what is not seen, (h, w), from ever wider neighbourhoods of what is (push and pull).

    A white ceiling has the colour of the light of the room.
    """
    from scipy.ndimage import gaussian_filter

    area = solid_angles()[:, None]
    result, known = shown * seen[..., None], seen.copy()
    for sigma in (1.0, 2.0, 4.0, 8.0, 16.0, 48.0):
        weight = gaussian_filter(seen * area, sigma, mode=("nearest", "wrap"))
        colour = (
            np.stack(
                [gaussian_filter(shown[..., c] * seen * area, sigma, mode=("nearest", "wrap")) for c in range(3)],
                axis=-1,
            )
            / np.maximum(weight, 1e-12)[..., None]
        )
        share = np.clip(weight / area * 4, 0, 1) * (1 - known)
        result += share[..., None] * colour
        known += share
    return np.asarray(result / np.maximum(known, 1e-6)[..., None])


def _ground_level(samples: _Samples) -> float:
    """Luminance of what is below the place."""
    below = samples.directions[:, 2] < -0.5
    return float(np.median(luminance(samples.colours[below if below.any() else ~samples.sky])))


def _white_level(samples: _Samples) -> float:
    """Luminance of the brightest ordinary surfaces."""
    return float(np.quantile(luminance(samples.colours), 1 - BRIGHTER_SHARE))


def _lamp_direction(middle: FloatArray, basis: FloatArray, cloud: Cloud) -> FloatArray:
    """(3,) unit direction, in the basis, from the object to the place high above the middle of the room."""
    local = (cloud.points - middle) @ basis.T
    low, high = np.percentile(local, [5, 95], axis=0)
    lamp = np.append((low + high)[:2] / 2, max(float(high[2]), 0.25 * float((high - low)[:2].max())))
    return np.asarray(lamp / max(float(np.linalg.norm(lamp)), 1e-12))


def _raise_top(filled: FloatArray, seen: FloatArray, white: float, lamp: FloatArray) -> FloatArray:
    """The unseen upper part scaled so that white under this light has the level `white`: E(up) = pi white / albedo.

    LAMP_SHARE of the unseen part's irradiance becomes a lobe about the lamp's direction (3,).
    """
    directions = map_directions()
    rise = np.maximum(directions[..., 2], 0.0)
    weight = rise * solid_angles()[:, None]
    hidden = (1 - seen) * (rise > 0)
    bright = luminance(filled)
    shown = float((weight * (1 - hidden) * bright).sum())
    unseen = float((weight * hidden * bright).sum())
    lobe = hidden * np.maximum(directions @ lamp, 0.0) ** LAMP_POWER
    total = float((weight * lobe).sum())
    if unseen <= 1e-9 or total <= 1e-9:
        return filled
    wanted = unseen * float(np.clip((np.pi * white / WHITE_ALBEDO - shown) / unseen, *UNSEEN))
    mean = np.einsum("hw,hwc->c", weight * hidden, filled)
    colour = mean / max(float(luminance(mean)), 1e-9)
    rest = 1 + ((1 - LAMP_SHARE) * wanted / unseen - 1) * hidden
    return np.asarray(filled * rest[..., None] + (LAMP_SHARE * wanted / total) * lobe[..., None] * colour)


def _with_unseen(filled: FloatArray, seen: FloatArray, radiance: float) -> FloatArray:
    """The unseen upper part scaled so that its mean luminance, by what reaches a level surface, is `radiance`.

    filled and the result : (h, w, 3) radiance; seen : (h, w) 0 to 1.
    """
    hidden = (1 - seen) * (map_directions()[..., 2] > 0)
    weight = hidden * np.maximum(map_directions()[..., 2], 0.0) * solid_angles()[:, None]
    unseen = float((weight * luminance(filled)).sum())
    if unseen <= 1e-9:
        return filled
    times = float(np.clip(radiance * weight.sum() / unseen, *UNSEEN))
    return np.asarray(filled * (1 + (times - 1) * hidden)[..., None])
