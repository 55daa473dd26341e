"""Compute the checks with a number of an insertion: shadow on the support, noise, motion blur and a grey card.

    python -m benchmarks.insertion.acceptance [--patch FRAME,X,Y,SIZE] [--exposure E] [--depth DIR] SCENE OPTIONS

OPTIONS are those of insert-object.

Prints one line of JSON for each object and frame with the checks that apply:

- `shadow`: fraction of the shadow on the support plane that is drawn, in pixels without the object and its occluders.
- `on_support`: the same fraction in pixels that show the support (goal: 0.98), if `--depth` is a folder of depth maps
  `STEM.npz` with `raw` depths in scene units: the depth is within 5 % of that of the support in the complete 7 x 7
  window that such maps are matched by.
- `noise`: grain of the objects over that of the plate within 16 levels, by channel (goal: 0.8 to 1.2; not for glass,
  which shows that of the plate). Both are the 0.15 quantile over squares of 8 pixels of the standard deviation of
  diagonal differences, at least that of rounding.
- `blur`: drawn length of the motion blur over that of the poses with the true exposure `--exposure` (goal: 0.7 to 1.3).

and for each patch, a white or grey surface, red and blue over green of a grey card over those of the patch (goal: 0.92
to 1.08).
"""

from __future__ import annotations

import argparse
import json
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from benchmarks.insertion.grey_card import card_ratios
from insertion.colour import Image, linear_to_srgb, srgb_to_linear
from insertion.composite.camera_look import PLAIN_QUANTILE, SQUARE_PX
from insertion.composite.compose import Composite, ObjectComposite
from insertion.composite.compositor import Compositor, composite_footage
from insertion.composite.motion_blur import motion_blur
from insertion.footage.footage import Frame, VideoFootage
from insertion.insertion_scene import open_scene
from insertion.placement.placed_object import place_objects
from metric_cli.insert_object.insert import parse_request

#: Minimum coverage of an opaque pixel, and minimum number of squares for a noise.
MIN_OPAQUE, MIN_SQUARES = 0.99, 12
#: Margin around the level of a square of an object within which squares of the plate are compared.
LEVEL_MARGIN = 16.0
#: Standard deviation of rounding to levels; less grain than this is invisible.
ROUNDING = 0.29
#: Distance between the squares of an object in pixels.
OBJECT_STEP_PX = 2
#: Maximum relative difference between the depths of the frame and of the support, and side of the matched windows.
DEPTH_TOLERANCE, WINDOW_PX = 0.05, 7


class Checks:
    """Sink that computes the checks of each frame, with depth maps from a folder if there are any."""

    def __init__(self, depths: Path | None = None) -> None:
        self._depths, self._has_glass = depths, False
        self.rows: list[dict[str, Any]] = []
        self._name, self._plate = "", np.empty((0, 0, 3), np.uint8)

    def plate(self, frame: Frame, image: Image) -> None:
        """Keep the frame without objects."""
        self._name, self._plate = frame.name, image

    def layers(self, frame: Frame, index: int, item: ObjectComposite) -> None:
        """Compare the drawn shadow with that on the support plane."""
        self._has_glass |= item.layers.image.glass is not None
        is_free = (item.layers.image.coverage < 0.01) & (item.occluded < 0.01) & np.isfinite(item.layers.plane_depth)
        shadow = (1 - item.layers.catcher_light).mean(axis=-1) * is_free
        drawn = np.minimum((1 - item.transmitted).mean(axis=-1), shadow)
        row = {"frame": frame.name, "object": index, "smear_px": float(np.linalg.norm(item.smear))}
        row["shadow"] = float(drawn.sum() / max(shadow.sum(), 1e-9))
        if self._depths is not None:
            with np.load(self._depths / f"{Path(frame.name).stem}.npz") as maps:
                ratio = maps["raw"][item.layers.box.slices] / item.layers.plane_depth
            on_support = cv2.erode(np.uint8(np.abs(ratio - 1) < DEPTH_TOLERANCE), np.ones((WINDOW_PX, WINDOW_PX)))
            row["on_support"] = float((drawn * on_support).sum() / max((shadow * on_support).sum(), 1e-9))
        self.rows.append(row)

    def composite(self, _: Frame, composite: Composite) -> None:
        """Compare the grain of the objects with that of the plate."""
        box = composite.box.slices
        alpha = composite.visible_foreground[..., 3:]
        light = srgb_to_linear(self._plate[box]) * composite.visible_transmittance * (1 - alpha)
        levels = linear_to_srgb(light + composite.visible_foreground[..., :3])
        opaque = alpha[..., 0] > MIN_OPAQUE
        grain = squares(composite.image[box] - levels, opaque, OBJECT_STEP_PX)
        if self._has_glass or len(grain) < MIN_SQUARES:
            return
        plate = squares(self._plate.astype(np.float32), np.ones(self._plate.shape[:2], bool))
        plate_levels, plate_widths = plate.mean(axis=1), widths(plate)  # (n, 3)
        object_levels, object_widths = squares(levels, opaque, OBJECT_STEP_PX).mean(axis=1), widths(grain)
        ratios = []
        for k in range(3):
            near = np.abs(plate_levels[:, k] - object_levels[:, None, k]) < LEVEL_MARGIN  # (m, n)
            plain = [np.quantile(plate_widths[row, k], PLAIN_QUANTILE) if row.any() else np.nan for row in near]
            ratios.append(np.nanquantile(object_widths[:, k] / plain, PLAIN_QUANTILE))
        for row in self.rows:
            if row["frame"] == self._name:
                row["noise"] = [round(float(ratio), 2) for ratio in ratios]


def squares(image: NDArray[np.float32], mask: NDArray[np.bool_], step: int = SQUARE_PX) -> NDArray[np.float32]:
    """Return the squares (n, p, 3) of an image (h, w, 3), `step` pixels apart, that are completely in a mask (h, w)."""
    side = (SQUARE_PX, SQUARE_PX)
    is_inside = sliding_window_view(mask, side)[::step, ::step].all(axis=(2, 3))
    chosen = sliding_window_view(image, side, axis=(0, 1))[::step, ::step][is_inside]  # (n, 3, s, s)
    return np.asarray(chosen.reshape(-1, 3, SQUARE_PX**2).swapaxes(1, 2), dtype=np.float32)


def widths(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the standard deviations (n, 3), at least `ROUNDING`, of the diagonal differences of squares (n, p, 3)."""
    x = values.reshape(-1, SQUARE_PX, SQUARE_PX, 3)
    differences = (x[:, 1:, 1:] - x[:, 1:, :-1] - x[:, :-1, 1:] + x[:, :-1, :-1]) / 2
    return np.asarray(np.maximum(differences.std(axis=(1, 2)), ROUNDING), dtype=np.float32)


def main() -> None:
    """Insert the objects in memory and print the checks."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--patch", action="append", default=[])
    parser.add_argument("--exposure", type=float)
    parser.add_argument("--depth", type=Path)
    options, argv = parser.parse_known_args()
    _, request = parse_request([*argv, "--out", "not-written.mp4"])
    scene = open_scene(request.scene)
    video = scene.footage if isinstance(scene.footage, VideoFootage) else None
    objects = place_objects(request.objects, scene.space, scene.footage.frames, request.tree)
    footage = scene.footage if request.frames is None else scene.footage.between(*request.frames)
    motion = None if video is None else motion_blur(video.frames, scene.images, scene.content.cloud)
    checks = Checks(options.depth)
    drawing = Compositor(
        objects, scene.light, scene.content, footage.start_s, video is not None, sinks=[checks], motion=motion
    )
    with closing(drawing):
        composite_footage(drawing, footage, scene.scale, lambda *_: None)
    for row in checks.rows:
        if motion is not None and motion.fraction > 0 and options.exposure:
            row["blur"] = round(motion.fraction / options.exposure, 2)
        print(json.dumps({name: round(value, 3) if isinstance(value, float) else value for name, value in row.items()}))
    for patch in options.patch:
        seen, card = card_ratios(scene, patch)
        print(json.dumps({"patch": patch, "card_over_patch": [round(float(v), 2) for v in card / seen]}))


if __name__ == "__main__":
    main()
