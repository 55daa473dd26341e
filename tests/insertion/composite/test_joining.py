"""Joining by known answers: blends, gains and borders of a composite, blur, grain, and votes on depth."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from estimator.records.scene import Instance
from insertion.colour import linear_to_srgb, luminance, srgb_to_linear
from insertion.composite import camera_look as match
from insertion.composite import occlusion, shadow_receivers
from insertion.composite.camera_look import (
    CameraLook,
    CameraLookTracker,
    blur_layer,
    direction_index,
    gradients,
    grain,
    limit_widths,
)
from insertion.composite.compose import ObjectComposite, composite_objects, covered_box, occlude_mutually
from insertion.render.layers import ObjectLayers
from insertion.render.renderer import ObjectImage
from insertion.scene.camera_rays import scene_positions
from insertion.scene.pixel_box import PixelBox
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints
from tests.insertion.composite.test_received import _view

# Published values, written out so that a changed rule fails a test.
BLUR_UPDATE_WEIGHT = 0.8
GRAIN_FRAMES = 30
MAX_BLUR_REACH_PX = 12
MIN_BLUR_PX = 0.35
UPDATE_WEIGHT = 0.35

SHARP = np.eye(2) * MIN_BLUR_PX**2
LOOK = CameraLook(np.ones(3), SHARP, np.zeros((8, 3)), 0.0)
GREY = np.full((30, 40, 3), 100, np.uint8)


def _joined(
    box: PixelBox, alpha: float, colour: float, hidden: float = 0.0, share: float = 1.0, depth: float = 2.0
) -> ObjectComposite:
    shape = box.shape
    image = ObjectImage(
        np.full((*shape, 3), colour * alpha, np.float32), np.full(shape, alpha, np.float32),
        np.full(shape, depth, np.float32),
    )  # fmt: skip
    layers = ObjectLayers(box, image, np.ones((*shape, 3), np.float32), np.full(shape, np.nan, np.float32))
    return ObjectComposite(layers, np.full(shape, hidden, np.float32), np.full((*shape, 3), share, np.float32))


def _srgb(light: float) -> int:
    return round(float(linear_to_srgb(np.array(light))))


def test_a_blend_is_by_its_formula_in_linear_light() -> None:
    plate = float(srgb_to_linear(np.array(100, np.uint8)))
    item = _joined(PixelBox(8, 6, 30, 25), 0.8, 0.6, hidden=0.25, share=0.5)
    gain = np.array([1.5, 1.0, 0.5])
    out = composite_objects(GREY, [item], replace(LOOK, gain=gain), 0)
    cover = 0.8 * 0.75
    wanted = [_srgb(plate * 0.5 * (1 - cover) + g * 0.6 * cover) for g in gain]
    assert np.abs(out.image[6:25, 8:30].astype(int) - wanted).max() <= 1
    assert (out.image[:6] == 100).all()
    assert (out.image[:, 30:] == 100).all()
    assert out.box == item.layers.box
    assert out.changed.all()
    assert out.visible_foreground[..., 3] == pytest.approx(cover)
    assert out.visible_transmittance == pytest.approx(0.5)
    assert item.alpha == pytest.approx(cover)
    assert item.visible == pytest.approx(0.75)


def test_fractions_of_light_multiply_and_objects_add_in_common_pixels() -> None:
    plate = float(srgb_to_linear(np.array(100, np.uint8)))
    one, two = (
        _joined(PixelBox(0, 0, 20, 30), 0.5, 0.9, share=0.5),
        _joined(PixelBox(15, 5, 40, 20), 0.0, 0.0, share=0.4),
    )
    out = composite_objects(GREY, [one, two], LOOK, 0)
    assert out.box == PixelBox(0, 0, 40, 30)
    assert out.visible_transmittance[10, 17] == pytest.approx(0.2)
    assert out.visible_transmittance[25, 30] == pytest.approx(1)
    assert abs(int(out.image[10, 17, 0]) - _srgb(plate * 0.2 * 0.5 + 0.45)) <= 1
    assert abs(int(out.image[10, 30, 0]) - _srgb(plate * 0.4)) <= 1
    assert out.image[25, 30].tolist() == [100] * 3
    alpha, depth = two.full_size((30, 40, 3))
    assert np.isnan(depth[0, 0])
    assert (depth[5:20, 15:] == 2.0).all()
    assert not alpha.any()
    nothing = composite_objects(GREY, [], LOOK, 0)
    assert nothing.image is GREY
    assert not nothing.changed.any()
    assert nothing.visible_transmittance == pytest.approx(1)


def test_coverage_blends_an_object_with_the_objects_behind_it() -> None:
    near, far = (
        _joined(PixelBox(0, 0, 20, 20), 0.5, 1.0, hidden=0.2),
        _joined(PixelBox(10, 10, 30, 30), 1.0, 1.0, 0.5, depth=3.0),
    )
    first, second = occlude_mutually([near, far])
    assert first.occluded == pytest.approx(0.2)
    assert second.occluded[:10, :10] == pytest.approx(1 - 0.5 * 0.5)
    assert second.occluded[10:, 10:] == pytest.approx(0.5)


def test_the_covered_part_has_room_for_a_blur_within_the_picture() -> None:
    alpha = np.zeros((60, 90), np.float32)
    alpha[30:33, 40:45] = 1
    assert covered_box(alpha) == PixelBox(
        40 - MAX_BLUR_REACH_PX, 30 - MAX_BLUR_REACH_PX, 45 + MAX_BLUR_REACH_PX, 33 + MAX_BLUR_REACH_PX
    )
    alpha[0, 0] = alpha[59, 89] = 0.1
    assert covered_box(alpha) == PixelBox(0, 0, 90, 60)
    assert covered_box(0 * alpha) == PixelBox(0, 0, 1, 1)


def test_boxes_meet_and_join_by_their_pixels() -> None:
    one, two = PixelBox(0, 5, 10, 20), PixelBox(8, 2, 30, 9)
    assert (one.shape, one.slices) == ((15, 10), (slice(5, 20), slice(0, 10)))
    assert one.union(two) == PixelBox(0, 2, 30, 20)
    assert one.union(None) == one
    assert one.overlap(two) == PixelBox(8, 5, 10, 9)
    assert one.overlap(PixelBox(10, 5, 12, 20)) is None
    assert one.overlap(PixelBox(0, 20, 10, 22)) is None
    assert PixelBox(8, 5, 10, 9).within(two) == (slice(3, 7), slice(0, 2))


def test_the_display_curve_and_its_inverse() -> None:
    levels = np.arange(256, dtype=np.uint8)
    linear = srgb_to_linear(levels)
    assert linear[[0, 10, 255]] == pytest.approx([0, 10 / 255 / 12.92, 1])
    assert linear[188] == pytest.approx(((188 / 255 + 0.055) / 1.055) ** 2.4, rel=1e-6)
    assert linear_to_srgb(linear) == pytest.approx(levels, abs=1e-3)
    assert linear_to_srgb(np.array([-1.0, 2.0])) == pytest.approx([0, 255])
    assert linear_to_srgb(np.zeros((0, 3))).shape == (0, 3)
    assert luminance(np.eye(3)) == pytest.approx([0.2126, 0.7152, 0.0722])


def test_directions_of_edges_over_half_a_turn() -> None:
    angle = np.radians([0, 30, 60, 90, 120, 150, 179, 184, -90])
    assert direction_index(np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)).tolist() == [
        0, 1, 2, 3, 4, 5, 0, 0, 3,
    ]  # fmt: skip
    slope = np.fromfunction(lambda y, x: 3 * x - 2 * y, (8, 9)).astype(np.float32)
    across, down = gradients(slope)
    assert across[1:-1, 1:-1] == pytest.approx(3)
    assert down[1:-1, 1:-1] == pytest.approx(-2)


def test_widths_of_a_blur_are_kept_within_bounds() -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    wide = turn @ np.diag([100.0, 0.01]) @ turn.T
    assert limit_widths(wide, 0.35, 4.0) == pytest.approx(turn @ np.diag([16.0, 0.35**2]) @ turn.T)
    layer = np.zeros((31, 31, 4), np.float32)
    layer[15, 15] = 1
    slanted = turn @ np.diag([6.0, 1.0]) @ turn.T + SHARP
    spread = blur_layer(layer, slanted)[..., 0]
    y, x = np.indices(spread.shape) - 15
    moments = [[(spread * x * x).sum(), (spread * x * y).sum()], [(spread * x * y).sum(), (spread * y * y).sum()]]
    assert np.array(moments) == pytest.approx(turn @ np.diag([6.0, 1.0]) @ turn.T, rel=0.06, abs=0.05)
    border = blur_layer(np.ones((9, 9, 4), np.float32), slanted)
    assert border == pytest.approx(1, abs=1e-5)


def test_grain_has_its_strength_by_brightness_its_smoothness_and_what_channels_share() -> None:
    sigma = np.tile(np.linspace(1, 8, 8)[:, None], 3) * [1.0, 0.5, 0.25]
    look = CameraLook(np.ones(3), SHARP, sigma, 0.0, 0.6)
    box = PixelBox(0, 0, 150, 120)
    for level, strength in ((16, 1.0), (128, 4.5), (240, 8.0), (0, 1.0)):
        noise = grain(look, box, np.full((120, 150, 3), level, np.float32), 3)
        assert noise.std(axis=(0, 1)) == pytest.approx(strength * np.array([1.0, 0.5, 0.25]), rel=0.03)
    flat = noise.reshape(-1, 3)
    assert np.corrcoef(flat.T)[0, 1:] == pytest.approx([0.6, 0.6], abs=0.03)
    assert np.corrcoef(noise[:, 1:, 0].ravel(), noise[:, :-1, 0].ravel())[0, 1] == pytest.approx(0, abs=0.03)
    smooth = grain(replace(look, grain_px=1.0), box, np.full((120, 150, 3), 240, np.float32), 3)
    assert smooth.std(axis=(0, 1))[0] == pytest.approx(8.0, rel=0.1)
    alike = np.corrcoef(smooth[:, 1:, 0].ravel(), smooth[:, :-1, 0].ravel())[0, 1]
    assert alike == pytest.approx(np.exp(-0.25), abs=0.04)
    assert not np.array_equal(noise, grain(look, box, np.full((120, 150, 3), 0, np.float32), 4))
    assert np.array_equal(noise, grain(look, box, np.full((120, 150, 3), 0, np.float32), 3))


def test_the_grain_of_an_image_is_estimated_by_brightness() -> None:
    import cv2

    generator = np.random.default_rng(0)
    noise = generator.standard_normal((160, 240, 4))
    noise = np.sqrt(0.5) * noise[..., :3] + np.sqrt(0.5) * noise[..., 3:]
    noise[:, 120:] *= 2.0
    levels = np.where(np.arange(240) < 120, 60, 180)[None, :, None]
    picture = np.clip(np.rint(levels + 2.0 * noise), 0, 255).astype(np.uint8)
    sigma, smooth, common = match.measure_grain(picture, cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32))
    assert sigma[1] == pytest.approx([2.0] * 3, rel=0.1)
    assert sigma[5] == pytest.approx([4.0] * 3, rel=0.35)
    assert smooth < 0.45
    assert common == pytest.approx(0.5, abs=0.08)
    black = np.zeros((60, 60, 3), np.uint8)
    assert match.measure_grain(black, black[..., 0].astype(np.float32))[1:] == (0.0, 0.0)
    blurred = cv2.GaussianBlur(noise[:, :120] * 8, (0, 0), 0.8)
    soft = np.clip(np.rint(100 + blurred), 0, 255).astype(np.uint8)
    assert match.measure_grain(soft, cv2.cvtColor(soft, cv2.COLOR_RGB2GRAY).astype(np.float32))[1] == pytest.approx(
        0.8, abs=0.25
    )


@pytest.mark.parametrize("texture", [0.0, 12.0])
@pytest.mark.parametrize("chroma", [1.0, 5.0])
def test_grain_of_each_channel_is_that_of_the_plate_beside_texture(texture: float, chroma: float) -> None:
    """Three quarters have a texture, which was taken for grain; the noise of blue was cut to that of grey."""
    generator = np.random.default_rng(4)
    levels = np.where(np.arange(320) < 160, 40, 150)[None, :, None] * np.ones((240, 320, 3))
    fine = cv2.GaussianBlur(generator.standard_normal((240, 320, 1)), (0, 0), 0.7)[..., None] * 2.5
    levels[:180] += texture * fine[:180]
    wanted = np.array([2.0, 1.5, 1.5 * chroma])
    noise = generator.standard_normal((240, 320, 3)) * wanted
    plate = np.clip(np.rint(levels + noise), 0, 255).astype(np.uint8)
    look = match.CameraLook(np.ones(3), np.eye(2), *match.measure_grain(plate, cv2.cvtColor(plate, cv2.COLOR_RGB2GRAY)))
    for level in (40, 150):
        added = grain(look, PixelBox(0, 0, 120, 90), np.full((90, 120, 3), level, np.float32), 1)
        np.testing.assert_allclose(added.std(axis=(0, 1)), wanted, rtol=0.2)


@pytest.mark.parametrize(("blue", "expected"), [(2.6, 2.6), (12.0, 3.1)])
def test_a_level_of_one_channel_that_only_texture_has_gets_no_coarse_grain(blue: float, expected: float) -> None:
    """A quarter of the plate has another level of blue, whose variation is that of paving (MAX_LEVEL_RATIO)."""
    generator = np.random.default_rng(6)
    noise = generator.standard_normal((240, 320, 3)) * 2.0
    noise[:, :80, 2] *= blue / 2
    levels = np.full((240, 320, 3), 60.0)
    levels[:, :80, 2] = 150
    plate = np.clip(np.rint(levels + noise), 0, 255).astype(np.uint8)
    sigma, _, _ = match.measure_grain(plate, cv2.cvtColor(plate, cv2.COLOR_RGB2GRAY).astype(np.float32))
    assert sigma[4, 2] == pytest.approx(expected, rel=0.15)
    assert sigma[1] == pytest.approx([2.0] * 3, rel=0.1)


@pytest.mark.parametrize(("sigma", "smooth"), [(3.0, 0.0), (0.8, 0.7)])
def test_the_finest_grain_is_that_of_the_plate_after_rounding(sigma: float, smooth: float) -> None:
    """Half of the plate is a compressed sky without grain, which does not make the grain of the other half smooth."""
    generator = np.random.default_rng(5)
    noise = generator.standard_normal((240, 320, 3))
    noise = cv2.GaussianBlur(noise, (0, 0), smooth) if smooth else noise
    levels = np.where(np.arange(320) < 160, 80.5, 180 + 0.02 * np.arange(320))[None, :, None]
    noise = np.where(np.arange(320)[None, :, None] < 160, sigma * noise / noise.std(), 0)
    plate = np.rint(levels + noise).astype(np.uint8)
    look = match.CameraLook(np.ones(3), np.eye(2), *match.measure_grain(plate, cv2.cvtColor(plate, cv2.COLOR_RGB2GRAY)))
    assert look.grain_px == pytest.approx(smooth, abs=0.15)
    added = np.rint(80.5 + grain(look, PixelBox(0, 0, 160, 240), np.full((240, 160, 3), 80, np.float32), 1))
    finest = [np.diff(np.diff(image, axis=0), axis=1).std() for image in (added, plate[:, :160].astype(float))]
    assert finest[0] == pytest.approx(finest[1], rel=0.12)


def _lit(points: int, gain: np.ndarray) -> tuple[np.ndarray, VisiblePoints, ColouredPoints]:
    picture = np.full((20, 30, 3), 120, np.uint8)
    rows, columns = np.divmod(np.arange(points), 30)
    front = VisiblePoints(np.arange(points), np.column_stack([columns, rows]) + 0.5, np.ones(points), False)
    colours = srgb_to_linear(picture[0, 0])[None] / gain
    return (
        picture,
        front,
        ColouredPoints(np.zeros((points, 3)), np.tile(colours, (points, 1)).astype(np.float32), False),
    )


def test_a_gain_needs_points_and_is_no_wider_than_two_stops() -> None:
    gain = np.array([1.3, 1.0, 0.7])
    assert match.measure_gain(*_lit(30, gain)) == pytest.approx(gain, rel=1e-5)
    assert match.measure_gain(*_lit(29, gain)).tolist() == [1, 1, 1]
    assert match.measure_gain(*_lit(60, np.array([8.0, 1.0, 0.25]))) == pytest.approx([4.0, 1.0, 0.25], rel=1e-5)
    picture, front, cloud = _lit(60, gain)
    clipped = np.where(np.arange(20)[:, None, None] < 1, 255, picture).astype(np.uint8)
    assert match.measure_gain(clipped, front, cloud) == pytest.approx(gain, rel=1e-5)


def test_looks_of_a_video_are_smooth_and_those_of_stills_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[CameraLook | None] = []

    def measure_look(
        picture: np.ndarray, front: VisiblePoints, cloud: ColouredPoints, same: CameraLook | None
    ) -> CameraLook:
        asked.append(same)
        return CameraLook(np.full(3, float(picture.max())), SHARP * picture.max(), np.full((8, 3), 2.0), 0.5)

    monkeypatch.setattr(match, "measure_look", measure_look)
    _, front, cloud = _lit(1, np.ones(3))
    bright, dark = np.full((2, 2, 3), 4, np.uint8), np.ones((2, 2, 3), np.uint8)
    stills = CameraLookTracker(smooth=False)
    assert [stills.next(p, front, cloud).gain[0] for p in (bright, dark)] == [4, 1]
    assert asked == [None, None]
    video = CameraLookTracker(smooth=True)
    first, second = (video.next(p, front, cloud) for p in (bright, dark))
    assert second.gain[0] == pytest.approx(4 ** (1 - UPDATE_WEIGHT))
    assert second.blur[0, 0] / SHARP[0, 0] == pytest.approx(BLUR_UPDATE_WEIGHT * 1 + (1 - BLUR_UPDATE_WEIGHT) * 4)
    for _ in range(GRAIN_FRAMES - 1):
        video.next(dark, front, cloud)
    assert asked[3] is first
    assert [k for k, same in enumerate(asked[2:]) if same is None] == [0, GRAIN_FRAMES]


def test_points_vote_in_each_pixel_of_a_mask() -> None:
    mask = np.ones((20, 40), bool)
    x = np.linspace(1, 39, 20)
    pixels = np.column_stack([np.tile(x, 3), np.repeat([4.0, 10.0, 16.0], 20)])
    vote = occlusion.vote_of_points(mask, pixels, pixels[:, 0] < 20)
    assert vote[:, :17].all()
    assert not vote[:, 23:].any()
    half = mask & (np.arange(40) < 10)
    assert not occlusion.vote_of_points(half, pixels, np.ones(60, bool))[:, 14:].any()


def test_a_mask_occludes_by_its_fraction_of_closer_points() -> None:
    mask, behind = np.zeros((20, 40), bool), np.full((20, 40), 3.0, np.float32)
    mask[5:15, 10:30] = True
    pixels = np.column_stack([np.linspace(11, 29, 10), np.full(10, 10.0)])
    every = np.ones(10, bool)

    def part(depths: np.ndarray, observed: np.ndarray = every, around: np.ndarray = ~mask | mask) -> np.ndarray | None:
        return occlusion.occluded_by_mask(mask, around, behind, pixels, depths, observed)

    near, far = np.full(10, 2.0), np.full(10, 4.0)
    assert np.array_equal(part(near), mask)
    assert not np.any(part(far))
    assert part(np.where(np.arange(10) < 3, 2.0, 3.0)) is None  # touching points do not vote
    assert np.array_equal(part(np.where(np.arange(10) < 4, 2.0, 3.0)), mask)
    assert np.array_equal(part(near, ~every), mask)
    mixed = part(np.where(pixels[:, 0] < 20, 2.0, 4.0))
    assert mixed is not None
    assert mixed[8:12, 11:17].all()
    assert not mixed[8:12, 24:].any()
    four_seen = np.where(np.arange(10) < 4, 2.0, 4.0)
    assert np.array_equal(part(four_seen, np.arange(10) < 4), mask)
    left = np.broadcast_to(np.arange(40) < 20, (20, 40))
    assert np.array_equal(part(np.where(pixels[:, 0] < 20, 2.0, 4.0), every, left), mask)


def test_a_mask_on_an_occluded_support_is_an_occluder() -> None:
    hidden, cup = np.zeros((30, 30), bool), np.zeros((30, 30), bool)
    hidden[20:], cup[10:20, 12:16] = True, True
    assert occlusion.stands_on_occluder(hidden, cup)
    assert not occlusion.stands_on_occluder(hidden, np.roll(cup, -6, axis=0))
    assert not occlusion.stands_on_occluder(hidden & (np.arange(30) < 14), cup)
    bottom = np.zeros((30, 30), bool)
    bottom[28:] = True
    assert not occlusion.stands_on_occluder(hidden, bottom | hidden)


def test_without_a_mask_a_dense_cloud_decides() -> None:
    behind = np.full((20, 60), 3.0, np.float32)
    where = np.ones((20, 60), bool)
    where[:, 50:] = False
    x, y = (grid.ravel() + 0.5 for grid in np.meshgrid(np.arange(0, 60, 2), np.arange(0, 20, 2)))
    depths = np.where(x < 20, 2.0, np.where(x < 40, 2.95, 4.0))
    nearer = occlusion.occluded_by_points(where, behind, np.column_stack([x, y]), depths, 10.0)
    assert nearer[:, :17].all()
    assert not nearer[:, 24:].any()
    few = occlusion.occluded_by_points(where, behind, np.column_stack([x, y])[:6], depths[:6], 10.0)
    assert not few.any()
    corner = np.column_stack([x, y])[(x < 4) & (y < 10)]
    reach = occlusion.occluded_by_points(where, behind, corner, np.full(len(corner), 2.0), 6.0)
    assert reach[4, :4].all()
    assert not reach[4, 8:].any()  # all points are on one side
    assert not occlusion.occluded_by_points(where & False, behind, corner, np.full(len(corner), 2.0), 6.0).any()


def test_the_depth_outside_of_the_silhouette_is_that_of_the_nearest_pixel() -> None:
    depth = np.full((6, 8), np.nan, np.float32)
    depth[2, 1], depth[2, 6] = 1.5, 2.5
    image = ObjectImage(np.zeros((6, 8, 3), np.float32), np.zeros((6, 8), np.float32), depth)
    image.alpha[2, 1] = image.alpha[2, 6] = 1.0
    view = _view()
    points = VisiblePoints(np.arange(4), np.full((4, 2), 7.5) - [0.0, 2.0], np.full(4, 2.0), False)
    mask = Instance("a", 0, "a", np.ones((6, 8), bool), (0, 0), 1.0)
    assert occlusion.occluded_fraction(image, PixelBox(0, 0, 8, 6), view, [mask], points, np.zeros(4, bool))[1].all()
    nearer = replace(points, pixels=np.full((4, 2), 0.5))
    assert not occlusion.occluded_fraction(image, PixelBox(0, 0, 8, 6), view, [mask], nearer, np.zeros(4, bool))[
        1
    ].any()


@pytest.mark.parametrize("shift", [-1, 0, 1])
def test_a_matte_moves_to_the_edge_of_the_picture(shift: int) -> None:
    picture = np.full((40, 60, 3), 40, np.uint8)
    picture[:, 30:] = (200, 180, 90)
    hidden = np.zeros((40, 60), bool)
    hidden[:, 30 + shift :] = True
    share = occlusion.guided_matte(hidden, picture, 4)
    assert share[:, :27] == pytest.approx(0, abs=0.02)
    assert share[:, 33:] == pytest.approx(1, abs=0.02)
    assert abs(float(share[20].sum()) - 30) < 0.75
    plain = occlusion.guided_matte(hidden, np.full_like(picture, 90), 4)
    assert abs(float(plain[20].sum()) - (30 - shift)) < 0.1
    assert occlusion.guided_matte(hidden & False, picture, 4).max() == 0
    assert occlusion.guided_matte(hidden | True, picture, 4).min() == 1


def test_values_are_smoothed_within_their_class() -> None:
    values = np.where(np.arange(20) < 10, 1.0, 5.0)[None, :, None].repeat(20, axis=0).astype(np.float32)
    left = np.broadcast_to(np.arange(20) < 10, (20, 20))
    spread = shadow_receivers.enlarge_within(values, left, 1.0, (40, 40))
    assert spread.shape == (40, 40, 1)
    assert spread[:, :24] == pytest.approx(1, abs=1e-4)
    assert shadow_receivers.enlarge_within(values, ~left, 1.0, (40, 40))[:, 17:] == pytest.approx(5, abs=1e-3)


def test_positions_of_pixels_have_the_depth_of_the_nearest_points() -> None:
    view = _view()
    local = np.array([[0.2, -0.1, 2.0], [-0.4, 0.3, 3.0]])
    scene = (local - view.translation) @ view.rotation
    rays = (local[:, :2] / local[:, 2:]).astype(np.float32)
    assert scene_positions(view, rays, local[:, 2]) == pytest.approx(scene, rel=1e-5)
    body: Any = SimpleNamespace(basis=np.eye(3), position=scene[0])  # a level plane through the first point
    inverse = shadow_receivers.plane_inverse_depth(rays, view, body)
    assert inverse[0] == pytest.approx(0.5, rel=1e-5)
    assert scene_positions(view, rays, 1 / inverse)[:, 2] == pytest.approx(scene[[0, 0], 2], abs=1e-5)


def test_the_proxy_is_the_plane_unless_most_points_contradict_it() -> None:
    where = np.ones((20, 40), bool)
    x, y = (part.ravel() + 0.5 for part in np.meshgrid(np.arange(0, 40, 2), np.arange(0, 20, 2)))
    pixels = np.column_stack([x, y])
    wall = np.where(x > 20, 0.3, 0.0)
    proxy = shadow_receivers.proxy_offset(where, pixels, wall, 6.0)
    assert proxy[:, :15] == pytest.approx(0.0, abs=1e-3)
    assert proxy[:, 27:] == pytest.approx(0.3, abs=1e-3)
    stray = np.where(np.arange(len(x)) % 25 == 7, 5.0, 0.0)  # four of a hundred
    assert shadow_receivers.proxy_offset(where, pixels, stray, 6.0) == pytest.approx(0.0, abs=1e-6)
    few = pixels[:4], np.full(4, 0.3)
    assert shadow_receivers.proxy_offset(where, *few, 6.0) == pytest.approx(0.0)  # five of nine are missing
    assert shadow_receivers.proxy_offset(where, *few, None) == pytest.approx(0.3, abs=1e-6)
    assert np.isnan(shadow_receivers.proxy_offset(where, pixels[:3], np.full(3, 0.3), None)).all()


@pytest.mark.parametrize(
    ("alpha", "share", "is_changed"),
    [(0.0011, 1.0, True), (0.0009, 1.0, False), (0.0, 0.9989, True), (0.0, 0.9991, False)],
)
def test_pixels_change_by_a_thousandth_of_coverage_or_light(alpha: float, share: float, is_changed: bool) -> None:
    made = composite_objects(GREY, [_joined(PixelBox(5, 5, 25, 25), alpha, 1.0, share=share)], LOOK, 0)
    assert made.changed.any() == is_changed
    assert not composite_objects(GREY, [], LOOK, 0).changed.any()
