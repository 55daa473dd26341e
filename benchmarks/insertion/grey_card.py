"""Compare the colour of a grey card in the estimated light with white or grey surfaces in an image.

    python -m benchmarks.insertion.grey_card SCENE --scale S --patch FRAME,X,Y,SIZE ...

Each patch is a white or grey surface in an image of the scene; the card lies level at its centre. Prints the ratios of
red and blue to green of both, and of the card over the patch. The patches are chosen by hand.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from insertion.colour import srgb_to_linear
from insertion.insertion_scene import InsertionScene, open_scene
from insertion.placement.at_pixel import placement_at_pixel
from insertion.request import SceneSource
from insertion.scene.scale import read_scale
from metric_base.arrays import FloatArray

#: Height above the surface at which the light is estimated, in metres.
CARD_HEIGHT_M = 0.1


def main() -> None:
    """Print one line for each patch."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--scale", type=float, required=True)
    parser.add_argument("--patch", action="append", required=True)
    options = parser.parse_args()
    scene = open_scene(SceneSource(folder=options.scene, scale=read_scale(options.scene, options.scale)))
    for patch in options.patch:
        seen, card = card_ratios(scene, patch)
        cells = [f"{row[0]:.2f}, {row[1]:.2f}" for row in (seen, card, card / seen)]
        print(f"| {patch} | {' | '.join(cells)} |")


def card_ratios(scene: InsertionScene, patch: str) -> tuple[FloatArray, FloatArray]:
    """Return red and blue over green (2,) of a patch `FRAME,X,Y,SIZE` of an image, and of a level grey card on it."""
    name, *numbers = patch.split(",")
    x, y, size = map(int, numbers)
    row = next(row for row, view in enumerate(scene.scene.views) if view.name == name)
    pixels = srgb_to_linear(scene.images.image(row)[y : y + size, x : x + size]).reshape(-1, 3)
    seen, height = np.median(pixels, axis=0), CARD_HEIGHT_M / scene.scale.metres_per_unit
    placement = placement_at_pixel(scene.space, scene.scene.views[row], x + size / 2, y + size / 2, height)
    card = scene.light.environment(placement.position, height).irradiance(placement.basis[2])
    return seen[[0, 2]] / seen[1], card[[0, 2]] / card[1]


if __name__ == "__main__":
    main()
