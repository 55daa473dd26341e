"""Compute the checks with a number of an insertion: shadow on the support, noise, motion blur and a grey card.

    python -m benchmarks.insertion.acceptance [--patch FRAME,X,Y,SIZE] [--exposure E] SCENE OPTIONS OF insert-object

Prints one line of JSON for each object and frame with the checks that apply:

- `shadow`: fraction of the shadow on the support plane that is drawn, in pixels without the object and its occluders
  (goal: 0.98 where no other surface is in front of the support).
- `noise`: grain of the objects over that of the plate at the same brightness, by channel (goal: 0.8 to 1.2). Both are
  the 0.15 quantile over squares of 8 pixels of the standard deviation of diagonal differences.
- `blur`: drawn length of the motion blur over that of the poses with the true exposure `--exposure` (goal: 0.7 to 1.3).

and for each patch, a white or grey surface, red and blue over green of a grey card over those of the patch (goal: 0.92
to 1.08).
"""

from __future__ import annotations

import argparse
import json
from contextlib import closing
from typing import Any

import numpy as np
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
#: Margin around the levels of the objects within which squares of the plate are compared.
LEVEL_MARGIN = 16.0


class Checks:
    """Sink that computes the checks of each frame."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []
        self._name, self._plate = "", np.empty((0, 0, 3), np.uint8)

    def plate(self, frame: Frame, image: Image) -> None:
        """Keep the frame without objects."""
        self._name, self._plate = frame.name, image

    def layers(self, frame: Frame, index: int, item: ObjectComposite) -> None:
        """Compare the drawn shadow with that on the support plane."""
        is_free = (item.layers.image.coverage < 0.01) & (item.occluded < 0.01) & np.isfinite(item.layers.plane_depth)
        shadow = (1 - item.layers.catcher_light).mean(axis=-1) * is_free
        drawn = np.minimum((1 - item.transmitted).mean(axis=-1), shadow)
        row = {"frame": frame.name, "object": index, "smear_px": float(np.linalg.norm(item.smear))}
        self.rows.append(row | {"shadow": float(drawn.sum() / max(shadow.sum(), 1e-9))})

    def composite(self, _: Frame, composite: Composite) -> None:
        """Compare the grain of the objects with that of the plate."""
        box = composite.box.slices
        alpha = composite.visible_foreground[..., 3:]
        light = srgb_to_linear(self._plate[box]) * composite.visible_transmittance * (1 - alpha)
        levels = linear_to_srgb(light + composite.visible_foreground[..., :3])
        opaque = alpha[..., 0] > MIN_OPAQUE
        grain = squares(composite.image[box] - levels, opaque)
        if len(grain) < MIN_SQUARES:
            return
        low, high = np.quantile(levels[opaque], [0.1, 0.9], axis=0)
        plate = squares(self._plate.astype(np.float32), np.ones(self._plate.shape[:2], bool))
        ratios = []
        for k in range(3):
            at = plate[..., k].mean(axis=1)
            near = plate[(at > low[k] - LEVEL_MARGIN) & (at < high[k] + LEVEL_MARGIN), :, k]
            ratios.append(plain_width(grain[..., k]) / plain_width(near) if len(near) >= MIN_SQUARES else np.nan)
        for row in self.rows:
            if row["frame"] == self._name:
                row["noise"] = [round(float(ratio), 2) for ratio in ratios]


def squares(image: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the squares (n, p, 3) of an image (h, w, 3) that are completely in a mask (h, w)."""
    rows, columns = (side // SQUARE_PX for side in mask.shape)
    stacked = np.dstack([image, mask])[: rows * SQUARE_PX, : columns * SQUARE_PX]
    stacked = stacked.reshape(rows, SQUARE_PX, columns, SQUARE_PX, 4).swapaxes(1, 2).reshape(-1, SQUARE_PX**2, 4)
    return np.asarray(stacked[stacked[..., 3].all(axis=1), :, :3], dtype=np.float32)


def plain_width(values: NDArray[np.float32]) -> float:
    """Return the standard deviation of the diagonal differences of the plainest squares (n, p), free of gradients."""
    x = values.reshape(-1, SQUARE_PX, SQUARE_PX)
    differences = (x[:, 1:, 1:] - x[:, 1:, :-1] - x[:, :-1, 1:] + x[:, :-1, :-1]) / 2
    return float(np.quantile(differences.std(axis=(1, 2)), PLAIN_QUANTILE))


def main() -> None:
    """Insert the objects in memory and print the checks."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--patch", action="append", default=[])
    parser.add_argument("--exposure", type=float)
    options, argv = parser.parse_known_args()
    _, request = parse_request([*argv, "--out", "not-written.mp4"])
    scene = open_scene(request.scene)
    video = scene.footage if isinstance(scene.footage, VideoFootage) else None
    objects = place_objects(request.objects, scene.space, scene.footage.frames, request.tree)
    footage = scene.footage if request.frames is None else scene.footage.between(*request.frames)
    motion = None if video is None else motion_blur(video.frames, scene.images, scene.content.cloud)
    checks = Checks()
    drawing = Compositor(
        objects, scene.light, scene.content, footage.start_s, video is not None, sinks=[checks], motion=motion
    )
    with closing(drawing):
        composite_footage(drawing, footage, scene.scale, lambda *_: None)
    for row in checks.rows:
        if motion is not None and motion.fraction > 0 and options.exposure:
            row["blur"] = round(motion.fraction / options.exposure, 2)
        print(json.dumps(row | {name: round(row[name], 3) for name in ("shadow", "smear_px")}))
    for patch in options.patch:
        seen, card = card_ratios(scene, patch)
        print(json.dumps({"patch": patch, "card_over_patch": [round(float(v), 2) for v in card / seen]}))


if __name__ == "__main__":
    main()
