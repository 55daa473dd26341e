"""Pictures of our own making, hostile ones too, and a small release that shows them."""

from __future__ import annotations

import hashlib
import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from metric_tree.store import Release
from tests import minitree


def shop_picture(seed: int = 0, size: tuple[int, int] = (240, 200), kind: str = "JPEG") -> bytes:
    """A coloured box on white, through a real encoder."""
    generator = np.random.default_rng(seed)
    image = Image.new("RGB", size, "white")
    colour = tuple(int(c) for c in generator.integers(10, 180, 3))
    ImageDraw.Draw(image).rectangle((60, 50, 179, 149), fill=colour)
    return encoded(image, kind)


def wallpaper(seed: int = 0, size: tuple[int, int] = (240, 200)) -> bytes:
    """Colours without any plain background."""
    pixels = np.random.default_rng(seed).integers(0, 256, (size[1] // 8, size[0] // 8, 3), dtype=np.uint8)
    return encoded(Image.fromarray(pixels).resize(size, Image.Resampling.NEAREST), "PNG")


def encoded(image: Image.Image, kind: str = "PNG") -> bytes:
    sink = BytesIO()
    image.save(sink, kind)
    return sink.getvalue()


def bomb() -> bytes:
    """A PNG of a few bytes whose header promises 2.5 thousand million pixels."""

    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    header = struct.pack(">IIBBBBB", 50_000, 50_000, 8, 2, 0, 0, 0)
    body = chunk(b"IDAT", zlib.compress(bytes(1000)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + body + chunk(b"IEND", b"")


def animation() -> bytes:
    frames = [Image.new("RGB", (100, 100), colour) for colour in ("red", "blue")]
    sink = BytesIO()
    frames[0].save(sink, "WEBP", save_all=True, append_images=frames[1:])
    return sink.getvalue()


#: Files that are no pictures, and what is said of each.
HOSTILE = {
    "bomb": (bomb(), "no_picture"),
    "truncated": (shop_picture()[:900], "broken"),
    "svg": (b'<svg xmlns="http://www.w3.org/2000/svg" width="200" height="200"/>', "no_picture"),
    "text named jpg": (b"not a picture" * 20, "no_picture"),
    "animated": (animation(), "animated"),
    "empty": (b"", "empty"),
    "gif": (encoded(Image.new("L", (100, 100)), "GIF"), "no_picture"),
    "thumbnail": (encoded(Image.new("RGB", (20, 20))), "too_small"),
}


def release_with(directory: Path, bodies: list[bytes]) -> Release:
    """The small release with a picture for each of its first items; files are named after their bytes."""
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
