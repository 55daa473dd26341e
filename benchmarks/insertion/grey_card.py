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
from insertion.insertion_scene import open_scene
from insertion.placement.at_pixel import placement_at_pixel
from insertion.request import SceneSource
from insertion.scene.scale import read_scale

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
    names = {view.name: row for row, view in enumerate(scene.scene.views)}
    height = CARD_HEIGHT_M / options.scale
    for patch in options.patch:
        name, *numbers = patch.split(",")
        x, y, size = map(int, numbers)
        pixels = srgb_to_linear(scene.images.image(names[name])[y : y + size, x : x + size]).reshape(-1, 3)
        seen = np.median(pixels, axis=0)
        view, middle = scene.scene.views[names[name]], (x + size / 2, y + size / 2)
        placement = placement_at_pixel(scene.space, view, *middle, height)
        card = scene.light.environment(placement.position, height).irradiance(placement.basis[2])
        ratios = [colour[[0, 2]] / colour[1] for colour in (seen, card)]
        cells = [f"{row[0]:.2f}, {row[1]:.2f}" for row in (*ratios, ratios[1] / ratios[0])]
        print(f"| {patch} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
