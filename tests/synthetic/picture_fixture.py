"""Synthetic images, invalid ones included, and a small release with images."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from PIL import Image

from metric_tree.release.release import Release
from tests.synthetic import minitree
from tests.synthetic.hostile_pictures import HOSTILE as MAKERS
from tests.synthetic.hostile_pictures import encoded, shop_picture

__all__ = ["HOSTILE", "encoded", "release_with", "shop_picture", "wallpaper"]


def wallpaper(seed: int = 0, size: tuple[int, int] = (240, 200)) -> bytes:
    """Return an image of random colours without a plain background."""
    pixels = np.random.default_rng(seed).integers(0, 256, (size[1] // 8, size[0] // 8, 3), dtype=np.uint8)
    return encoded(Image.fromarray(pixels).resize(size, Image.Resampling.NEAREST), "PNG")


#: Invalid image files, each with the code of its refusal.
HOSTILE = {name: (make(), code) for name, (make, code) in MAKERS.items() if code is not None}


def release_with(directory: Path, bodies: list[bytes]) -> Release:
    """Publish the small release with an image for each of its first items. Files are named by their checksum."""
    content = minitree.rows()
    folder = directory.with_name(f"{directory.name}.extras")
    folder.mkdir(parents=True)
    for item, body in zip(content["items.parquet"], bodies, strict=False):
        name = hashlib.sha256(body).hexdigest()
        path = f"pictures/{name[:2]}/{name}.jpg"
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(body)
        content["images.parquet"].append(
            {
                "image_id": name,
                "item_id": item["item_id"],
                "node_id": item["node_id"],
                "path": path,
                "width_px": 240,
                "height_px": 200,
                "source_url": f"https://example.org/{name[:8]}",
                "licence": "CC0-1.0",
            }
        )
    return minitree.release(directory, content, extras=folder)
