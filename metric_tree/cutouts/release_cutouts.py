"""Cut-outs of the images of a release, published as a new release with hard links to the unchanged files.

Each image has one row in `cutouts.parquet` and, unless it is rejected, a transparent PNG, cropped to its box, whose
alpha is the mask: `cutouts/aa/<sha256 of the image>.png`. Finished work is kept in a work folder until the release is
published; an interrupted run continues from it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from crawler.fetch.item_images import decode_image
from metric_base.errors import InputError
from metric_base.files import inside, sole_writer
from metric_tree.cutouts.backend import RGB, Auto, Backend, Settings
from metric_tree.pipeline.work_folder import BuildFolder, SerialExecutor, fingerprint
from metric_tree.release.images import image_path, link_images
from metric_tree.release.release import Release, publish_release, sha256
from metric_tree.release.schema import IMAGES, table_schema

#: Table of the cut-outs of a release, including the rejected ones.
TABLE = "cutouts.parquet"

FOLDER = "cutouts"

#: Images per call: a few seconds of a worker, so that an interruption loses little.
IMAGES_PER_CALL = 8

#: Minimum fraction of transparent pixels for transparency that is used as a mask; with less it is a soft border.
MIN_CLEAR_FRACTION = 0.01

#: Maximum longer side in pixels of an image that is cut out; more resolution does not improve the edge.
MAX_SIDE_PX = 1600


#: A row is an image; several items may share it.
CUTOUTS = table_schema("cutouts", "metric-tree/cutout/1")


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """The cut-out of an image: a row of `CUTOUTS`, and its PNG until it is written."""

    image_id: str
    png: bytes = b""
    cutout_path: str | None = None
    cutout_sha256: str | None = None
    method: str | None = None
    box_px: tuple[int, int, int, int] | None = None
    cut_width_px: int | None = None
    cut_height_px: int | None = None
    foreground_share: float | None = None
    quality: float | None = None
    set_aside: str | None = None
    detail: str | None = None


@cache
def backend(settings: Settings) -> Backend:
    """Return the backend of some settings; it is created once per process, because a network takes a second to load."""
    from metric_tree.cutouts.network import Network
    from metric_tree.cutouts.plain import Plain

    if settings.name == "plain":
        return Plain()
    if settings.name == "rembg":
        return Network.load(settings.model)
    return Auto(Plain(), Network.load(settings.model) if settings.weights else None)


def cut(image_id: str, body: bytes, settings: Settings) -> Cut:
    """Cut out the object of an image file; a file that is not an image is rejected as `unreadable`."""
    import numpy as np

    from metric_tree.cutouts.backend import Foreground
    from metric_tree.cutouts.guided import guided_foreground
    from metric_tree.cutouts.quality import assessment

    image = decode_image(body)
    if isinstance(image, str):
        return Cut(image_id=image_id, set_aside="unreadable", detail=image)
    try:
        pixels, alpha = upright_pixels(image)
    except (OSError, ValueError, SyntaxError) as error:  # invalid orientation tags and colour profiles
        return Cut(image_id=image_id, set_aside="unreadable", detail=str(error)[:80])
    guide = next((one for one in settings.drawn if one.picture == image_id), None)
    if guide is not None:
        foreground = guided_foreground(pixels, guide)
    elif alpha is not None:
        foreground = Foreground(alpha, "alpha")
    else:
        foreground = backend(settings).foreground(pixels)
    assessed = assessment(pixels, foreground.alpha)
    reason = foreground.refused or assessed.reason
    if guide is not None and reason == "doubtful":  # the reviewer accepted an edge without contrast
        reason = None
    row = Cut(
        image_id=image_id,
        method=foreground.method,
        cut_width_px=pixels.shape[1],
        cut_height_px=pixels.shape[0],
        set_aside=reason,
    )
    if foreground.refused:
        return row
    row = replace(row, box_px=assessed.box, foreground_share=assessed.share, quality=assessed.quality)
    return row if reason else replace(row, png=cropped_png(np.dstack([pixels, foreground.alpha]), assessed.box))


def upright_pixels(image: Any) -> tuple[RGB, Any | None]:
    """Return the upright pixels (h, w, 3) of a Pillow image on white, and its alpha channel if that is a mask.

    Larger images are scaled to `MAX_SIDE_PX`. The mask is (h, w) uint8, or None.
    """
    import numpy as np
    from PIL import Image, ImageOps

    upright = ImageOps.exif_transpose(image)
    upright.thumbnail((MAX_SIDE_PX, MAX_SIDE_PX), Image.Resampling.LANCZOS, reducing_gap=2.0)
    rgba = upright.convert("RGBA")
    alpha = np.asarray(rgba.getchannel("A"))
    white = Image.new("RGBA", rgba.size, (255, 255, 255, 255))
    pixels = np.asarray(Image.alpha_composite(white, rgba).convert("RGB"))
    return pixels, alpha if (alpha < 128).mean() >= MIN_CLEAR_FRACTION else None


def cropped_png(rgba: Any, box: tuple[int, int, int, int]) -> bytes:
    """Return a box of an RGBA image (h, w, 4) as PNG; transparent pixels are black, which hides the background."""
    import numpy as np
    from PIL import Image

    x, y, width, height = box
    crop = np.array(rgba[y : y + height, x : x + width])
    crop[crop[..., 3] == 0] = 0
    sink = BytesIO()
    Image.fromarray(crop).save(sink, "PNG", compress_level=4)
    return sink.getvalue()


def cut_batch(batch: Sequence[tuple[str, Path]], settings: Settings, extras: Path) -> list[Cut]:
    """Cut out the objects of some images, given as id and file, in one thread of a worker; PNGs are in `extras`."""
    import cv2

    cv2.setNumThreads(1)
    return [_written(cut(image_id, path.read_bytes(), settings), extras) for image_id, path in batch]


def cut_release(
    release: Release,
    out: Path,
    settings: Settings,
    *,
    version: str,
    created: str,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Release:
    """Publish a release with cut-outs of all its images.

    Parameters
    ----------
    release : Release
        Release with images.
    out : Path
        Folder of the new release, which must not exist.
    settings : Settings
        Backend.
    version, created : str
        Version and ISO date of the new release.
    executor : Executor, optional
        Executor of the calls; default this process.
    progress : callable, optional
        Called with the number of finished images and of all images.

    Raises
    ------
    InputError
        `out` exists or another process is writing it, or the release has no images.
    """
    if out.exists():
        raise InputError(f"{out}: already exists; expected a new path for a release")
    images = release.table("images")
    rows = images.select(["image_id", "path"]).to_pylist()
    files = {row["image_id"]: file for row in rows if (file := image_path(release.directory, row)) is not None}
    if not files:
        raise InputError(
            f"{release.directory / 'images.parquet'}: expected images with files; found none (`build` takes those of"
            " a crawl, and with `--include-withheld SOURCE` those that may not be redistributed)"
        )
    model = Path(settings.model)
    weights = sha256(model) if model.suffix == ".onnx" and model.is_file() else ""
    code = sorted(Path(__file__).parent.glob("*.py"))
    key = fingerprint([release.directory / "images.parquet", *code], repr(settings) + weights)
    with sole_writer(out), BuildFolder.open(out.with_name(f"{out.name}.cutout"), key) as work:
        extras = work.directory / "extras"
        extras.mkdir(exist_ok=True)
        link_images(release, extras)
        ids = sorted(files)
        batches = (ids[start : start + IMAGES_PER_CALL] for start in range(0, len(ids), IMAGES_PER_CALL))
        calls = (([(image_id, files[image_id]) for image_id in batch], settings, extras) for batch in batches)
        cuts: list[Cut] = []
        run = executor or SerialExecutor()
        for done in work.map("cut", cut_batch, calls, run):
            cuts += done
            if progress is not None:
                progress(len(cuts), len(files))
        table = pa.Table.from_pylist([asdict(one) for one in cuts], schema=CUTOUTS)
        pq.write_table(table, extras / TABLE, compression="zstd")
        by_id = {one.image_id: one for one in cuts}
        image_rows = images.to_pylist()
        for row in image_rows:
            if (one := by_id.get(row["image_id"])) is not None:
                row |= {"cutout_path": one.cutout_path, "foreground_share": one.foreground_share, "method": one.method}
        tables = {f"{name}.parquet": release.table(name) for name in ("nodes", "items", "priors")}
        tables["images.parquet"] = pa.Table.from_pylist(image_rows, schema=IMAGES)
        cutouts = {
            "of": {"name": release.manifest["name"], "version": release.manifest["version"]},
            "backend": settings.name,
            "guides": len(settings.drawn),
            "model": settings.model if settings.name == "rembg" or settings.weights else None,
            "pictures": len(cuts),
            "cut": dict(sorted(Counter(one.method or "" for one in cuts if not one.set_aside).items())),
            "set_aside": dict(sorted(Counter(one.set_aside for one in cuts if one.set_aside).items())),
            "sha256": sha256(extras / TABLE),
        }
        manifest = {**release.manifest, "version": version, "created": created, "cutouts": cutouts}
        return publish_release(out, tables, manifest, extras)


def _written(one: Cut, extras: Path) -> Cut:
    """Write the PNG of a cut-out; an incomplete file of an interrupted run is replaced."""
    if not one.png:
        return one
    file = inside(extras, f"{FOLDER}/{one.image_id[:2]}/{one.image_id}.png")  # the id is untrusted input
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(one.png)
    path = file.relative_to(extras).as_posix()
    return replace(one, png=b"", cutout_path=path, cutout_sha256=sha256(file))
