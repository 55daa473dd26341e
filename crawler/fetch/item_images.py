"""Images of items: checked, and stored once under the hash of their bytes."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, cast

from metric_base.errors import StorageError
from metric_base.files import whole_file

SCHEMA = "metric-tree/picture/1"

#: Why an image is refused.
Refusal = Literal["empty", "too_many_bytes", "no_picture", "too_small", "too_large", "animated", "broken"]

#: Maximum size of an image in bytes: ten times a large product photograph.
MAX_BYTES = 20_000_000

#: Minimum and maximum side in pixels: smaller images have no usable edge, larger ones are posters or attacks.
SIDE_RANGE_PX = (64, 12_000)

#: Maximum number of pixels: forty million take 160 MB when decoded with transparency.
MAX_PIXELS = 40_000_000

_ENDINGS = {"JPEG": "jpg", "PNG": "png", "WEBP": "webp"}


@dataclass(frozen=True, slots=True)
class Picture:
    """A stored image, with its hash, item, source, file and size.

    attribution : who is to be named, if not the source; pixels_per_metre : of an orthographic image;
    foreground_share : of an image whose transparency is an exact mask.
    """

    image_id: str
    item_id: str
    source_url: str
    path: str
    width_px: int
    height_px: int
    attribution: str | None = None
    pixels_per_metre: float | None = None
    foreground_share: float | None = None

    @property
    def identity(self) -> str:
        """What makes the record one: an image shown by two items is two records and one file."""
        return f"picture:{self.image_id}:{self.item_id}"

    def line(self) -> str:
        """The record as one JSON line."""
        stated = {name: value for name, value in asdict(self).items() if value is not None}
        return json.dumps({"schema": SCHEMA, **stated}, ensure_ascii=False)


def picture(body: bytes, url: str, item_id: str, folder: Path) -> Picture | Refusal:
    """The image of a body, stored in `folder`, or why it was refused.

    Only JPEG, PNG and WebP stills pass; the header's size is checked before a pixel is unpacked.
    """
    image: Any | Refusal = decode_picture(body)
    if isinstance(image, str):
        return cast(Refusal, image)
    ending, (width, height) = _ENDINGS[image.format], image.size
    name = hashlib.sha256(body).hexdigest()
    path = Path(name[:2]) / f"{name}.{ending}"
    _store(folder / path, body)
    return Picture(name, item_id, url, path.as_posix(), width, height)


def decode_picture(body: bytes) -> Any | Refusal:
    """The Pillow image of a body, its pixels unpacked, or why it was refused."""
    if not body:
        return "empty"
    if len(body) > MAX_BYTES:
        return "too_many_bytes"
    from PIL import Image, UnidentifiedImageError

    try:
        image = Image.open(BytesIO(body), formats=list(_ENDINGS))
        refused = _refusal(image)
        if refused is None:
            image.load()
    except (UnidentifiedImageError, Image.DecompressionBombError):
        return "no_picture"
    except (OSError, ValueError, SyntaxError, KeyError):  # what Pillow raises for truncated and crooked files
        return "broken"
    return refused or image


def _refusal(image: Any) -> Refusal | None:
    """Return the reason to reject an image because of its header, or None."""
    if getattr(image, "is_animated", False):
        return "animated"
    if min(image.size) < SIDE_RANGE_PX[0]:
        return "too_small"
    if max(image.size) > SIDE_RANGE_PX[1] or image.width * image.height > MAX_PIXELS:
        return "too_large"
    return None if image.format in _ENDINGS else "no_picture"


def _store(path: Path, body: bytes) -> None:
    if path.exists():
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as work:
            work.write_bytes(body)
    except OSError as error:
        raise StorageError(f"{path}: expected space for an image, found: {error.strerror}") from None
