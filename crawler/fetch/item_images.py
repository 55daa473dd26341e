"""Check images of items, and store them once under the hash of their bytes."""

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

#: Reason to reject an image.
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
    """A stored image of an item."""

    image_id: str  #: SHA-256 of its bytes.
    item_id: str
    source_url: str
    path: str
    width_px: int
    height_px: int
    attribution: str | None = None  #: Author, if it is not the source.
    pixels_per_metre: float | None = None  #: For orthographic images.
    foreground_share: float | None = None  #: For images whose transparency is an exact mask.

    @property
    def identity(self) -> str:
        """Identity of the record; an image of two items has two records and one file."""
        return f"picture:{self.image_id}:{self.item_id}"

    def line(self) -> str:
        """Return the JSON line of the record."""
        stated = {name: value for name, value in asdict(self).items() if value is not None}
        return json.dumps({"schema": SCHEMA, **stated}, ensure_ascii=False)


def picture(body: bytes, url: str, item_id: str, folder: Path) -> Picture | Refusal:
    """Store the image of a response in `folder`, or return the reason to reject it.

    Only JPEG, PNG and WebP still images are accepted. The size in the header is checked before decoding.
    """
    image: Any | Refusal = decode_image(body)
    if isinstance(image, str):
        return cast(Refusal, image)
    ending, (width, height) = _ENDINGS[image.format], image.size
    name = hashlib.sha256(body).hexdigest()
    path = Path(name[:2]) / f"{name}.{ending}"
    if not (folder / path).exists():
        try:
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            with whole_file(folder / path) as work:
                work.write_bytes(body)
        except OSError as error:
            raise StorageError(f"{folder / path}: expected space for an image, found: {error.strerror}") from None
    return Picture(name, item_id, url, path.as_posix(), width, height)


def decode_image(body: bytes) -> Any | Refusal:
    """Return the decoded Pillow image of a response, or the reason to reject it."""
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
    except (OSError, ValueError, SyntaxError, KeyError):  # errors of Pillow for truncated and invalid files
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
