"""Invalid and malicious image files: result, time and memory of a cutout.

    python -m tests.synthetic.hostile_pictures

Each file is processed by `metric_tree.cutouts.release_cutouts.cut`, as in `metric-tree cutout`, in a separate process
to measure its peak memory. The first two rows are valid images, a small one and one close to the size limit.
"""

from __future__ import annotations

import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

__all__ = ["HOSTILE", "encoded", "shop_picture"]

#: Linux's status of a process. Its peak memory does not include the parent's, unlike `getrusage`.
STATUS = Path("/proc/self/status")


def shop_picture(seed: int = 0, size: tuple[int, int] = (240, 200), kind: str = "JPEG") -> bytes:
    """Return an encoded image of a coloured box on white."""
    generator = np.random.default_rng(seed)
    image = Image.new("RGB", size, "white")
    colour = tuple(int(c) for c in generator.integers(10, 180, 3))
    ImageDraw.Draw(image).rectangle((60, 50, 179, 149), fill=colour)
    return encoded(image, kind)


def encoded(image: Image.Image, kind: str = "PNG") -> bytes:
    sink = BytesIO()
    image.save(sink, kind)
    return sink.getvalue()


def _png(side: int, pixels: bytes) -> bytes:
    """Return a grey PNG file with a header of `side` x `side` pixels and arbitrary pixel data."""

    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(pixels)), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def _large() -> bytes:
    """Return a valid image with almost the maximum number of pixels."""
    return encoded(Image.open(BytesIO(shop_picture())).resize((6_300, 6_300)), "JPEG")


def _animation(kind: str) -> bytes:
    frames = [Image.new("RGB", (100, 100), colour) for colour in ("red", "blue")]
    sink = BytesIO()
    frames[0].save(sink, kind, save_all=True, append_images=frames[1:])
    return sink.getvalue()


def _crooked_orientation() -> bytes:
    """Return a JPEG with a truncated orientation tag."""
    image = Image.open(BytesIO(shop_picture()))
    exif = image.getexif()
    exif[0x0112] = 6
    sink = BytesIO()
    image.save(sink, "JPEG", exif=exif.tobytes()[:-5])
    return sink.getvalue()


#: Valid images for comparison.
HONEST: dict[str, tuple[Callable[[], bytes], str | None]] = {
    "honest, 240 x 200 pixels": (shop_picture, None),
    "honest, 6,300 x 6,300 pixels": (_large, None),
}

#: Function that creates each file, and the code of its refusal; None if the file is a valid image.
HOSTILE: dict[str, tuple[Callable[[], bytes], str | None]] = {
    "bomb: header of 50,000 x 50,000": (lambda: _png(50_000, bytes(1000)), "no_picture"),
    "bomb: sound PNG of 8,000 x 8,000": (lambda: _png(8_000, bytes(8_000 * 8_001)), "too_large"),
    "21 MB of zeros": (lambda: bytes(21_000_000), "too_many_bytes"),
    "truncated JPEG": (lambda: shop_picture()[:900], "broken"),
    "truncated PNG": (lambda: shop_picture(kind="PNG")[:200], "broken"),
    "SVG": (lambda: b'<svg xmlns="http://www.w3.org/2000/svg" width="200" height="200"/>', "no_picture"),
    "text named .jpg": (lambda: b"not a picture" * 20, "no_picture"),
    "PNG named .jpg": (lambda: shop_picture(kind="PNG"), None),
    "animated WebP": (lambda: _animation("WEBP"), "animated"),
    "animated PNG": (lambda: _animation("PNG"), "animated"),
    "GIF": (lambda: encoded(Image.new("L", (100, 100)), "GIF"), "no_picture"),
    "20 x 20 pixels": (lambda: encoded(Image.new("RGB", (20, 20))), "too_small"),
    "empty file": (lambda: b"", "empty"),
    "crooked orientation tag": (_crooked_orientation, None),
}


def main() -> None:
    if len(sys.argv) > 1:
        _measure(Path(sys.argv[1]), sys.argv[2])
        return
    print("| file | bytes | result | seconds of processor | peak MB of the process |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.jpg"
        for name, (make, _) in (HONEST | HOSTILE).items():
            file.write_bytes(make())  # in this process, so that creating the file is not measured
            call = [sys.executable, "-m", "tests.synthetic.hostile_pictures", str(file), name]
            print(
                subprocess.run(call, check=True, capture_output=True, text=True, timeout=300).stdout, end="", flush=True
            )


def _measure(file: Path, name: str) -> None:
    from metric_tree.cutouts.backend import Settings
    from metric_tree.cutouts.release_cutouts import cut

    cut("warm", shop_picture(), Settings("plain"))
    body = file.read_bytes()
    started = time.process_time()
    result = cut("x", body, Settings("plain"))
    seconds = time.process_time() - started
    peak = next(int(line.split()[1]) for line in STATUS.read_text().splitlines() if line.startswith("VmHWM")) / 1024
    outcome = f"set aside: {', '.join(filter(None, (result.set_aside, result.detail)))}" if result.set_aside else "cut"
    print(f"| {name} | {len(body):,} | {outcome} | {seconds:.2f} | {peak:.0f} |")


if __name__ == "__main__":
    main()
