"""Foreground cut-outs for the images of a release: a new release, with the old one's files linked into it.

A release is never changed once published, so cutting publishes another. Each image gives one row of
`cutouts.parquet` and, unless it is set aside, one PNG with transparency, cropped to its box, whose alpha is the mask:
`cutouts/aa/<sha256 of the picture>.png`.
Finished work waits in a work folder until then; an interrupted run continues from it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from crawler.fetch.item_images import decode_picture
from metric_base.errors import InputError
from metric_base.files import inside
from metric_tree.cutouts.backend import RGB, Auto, Backend, Settings
from metric_tree.pipeline.work_folder import BuildFolder, SerialExecutor, fingerprint, sole_writer
from metric_tree.release.images import image_path, link_images
from metric_tree.release.release import Release, publish_release, sha256
from metric_tree.release.schema import IMAGES

#: The table of all cuts inside a release, those set aside too.
TABLE = "cutouts.parquet"

FOLDER = "cutouts"

#: Images of one call: a few seconds of a worker's time, so that a kill loses little.
PICTURES_PER_CALL = 8

#: A file's own transparency is its mask from this share of clear pixels; less is a soft frame.
CLEAR_SHARE = 0.01

#: Longer side of the image that is cut, in pixels: beyond it an edge gains nothing that a training set could use.
MAX_SIDE_PX = 1600


def _column(name: str, kind: pa.DataType, meaning: str) -> pa.Field:
    return pa.field(name, kind, metadata={"meaning": meaning})


#: One row is an image (not an item: two items may show it).
CUTOUTS = pa.schema(
    [
        _column("image_id", pa.string(), "sha256 of the picture"),
        _column("cutout_path", pa.string(), "RGBA file cropped to the box, null where set aside"),
        _column("cutout_sha256", pa.string(), "of that file"),
        _column("method", pa.string(), "plain, guided, alpha (the file's own transparency) or rembg:<model>"),
        _column("box_px", pa.list_(pa.int32()), "x, y, width, height of the foreground in the cut picture"),
        _column("cut_width_px", pa.int32(), "width of the picture as it was cut, after its orientation and size limit"),
        _column("cut_height_px", pa.int32(), "height of it"),
        _column("foreground_share", pa.float64(), "foreground pixels over all"),
        _column("quality", pa.float64(), "0 to 1: contrast along the edge, decided alpha"),
        _column("set_aside", pa.string(), "why there is no cut-out (`metric_tree.cutouts.quality.REASONS`), or null"),
        _column("detail", pa.string(), "more of the reason: why the file is no picture"),
    ],
    metadata={"schema": "metric-tree/cutout/1"},
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """One image's cut: a row of `CUTOUTS`, and the PNG, empty once it is written or where the cut is set aside."""

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
    """The backend of some settings, made once in a process: a network takes a second to load."""
    from metric_tree.cutouts.network import Network
    from metric_tree.cutouts.plain import Plain

    if settings.name == "plain":
        return Plain()
    if settings.name == "rembg":
        return Network.load(settings.model)
    return Auto(Plain(), Network.load(settings.model) if settings.weights else None)


def cut(image_id: str, body: bytes, settings: Settings) -> Cut:
    """The cut of one image's bytes; a file that is no image is set aside and harms no other."""
    import numpy as np

    from metric_tree.cutouts.backend import Foreground
    from metric_tree.cutouts.guided import guided_foreground
    from metric_tree.cutouts.quality import assessment

    image = decode_picture(body)
    if isinstance(image, str):
        return Cut(image_id=image_id, set_aside="unreadable", detail=image)
    try:
        picture, own = _pixels(image)
    except (OSError, ValueError, SyntaxError) as error:  # crooked orientation tags and colour profiles
        return Cut(image_id=image_id, set_aside="unreadable", detail=str(error)[:80])
    guide = next((one for one in settings.drawn if one.picture == image_id), None)
    if guide is not None:
        foreground = guided_foreground(picture, guide)
    elif own is not None:
        foreground = Foreground(own, "alpha")
    else:
        foreground = backend(settings).foreground(picture)
    assessed = assessment(picture, foreground.alpha)
    reason = foreground.refused or assessed.reason
    if guide is not None and reason == "doubtful":  # an orange among oranges has no edge of colour: its reviewer saw it
        reason = None
    row = Cut(
        image_id=image_id,
        method=foreground.method,
        cut_width_px=picture.shape[1],
        cut_height_px=picture.shape[0],
        set_aside=reason,
    )
    if foreground.refused:
        return row
    row = replace(row, box_px=assessed.box, foreground_share=assessed.share, quality=assessed.quality)
    return row if reason else replace(row, png=_png(np.dstack([picture, foreground.alpha]), assessed.box))


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
    """Publish at `out` the release with cut-outs of all its images; `progress` is called with (done, all).

    Raises
    ------
    InputError
        Something is at `out` already or another process is writing it, or the release has no images.
    """
    if out.exists():
        raise InputError(f"{out}: already exists; expected a new path for a release")
    images = release.table("images")
    paths = _files(release, images)
    if not paths:
        raise InputError(
            f"{release.directory / 'images.parquet'}: expected pictures with files; found none (`build` takes those of"
            " a crawl, and with `--include-withheld SOURCE` those that may not be given on)"
        )
    key = fingerprint([release.directory / "images.parquet", *_code()], repr(settings) + _model_sha(settings))
    with sole_writer(out), BuildFolder.open(out.with_name(f"{out.name}.cutout"), key) as work:
        extras = work.directory / "extras"
        extras.mkdir(exist_ok=True)
        link_images(release, extras)
        cuts: list[Cut] = []
        calls = ((batch, settings) for batch in _batches(paths))
        for done in work.map(
            "cut", _cut_batch, calls, executor or SerialExecutor(), lambda r, _: _write_cuts(r, extras)
        ):
            cuts += done
            if progress is not None:
                progress(len(cuts), len(paths))
        pq.write_table(_table(cuts), extras / TABLE, compression="zstd")
        tables = {f"{name}.parquet": release.table(name) for name in ("nodes", "items", "priors")}
        tables["images.parquet"] = _images_with_cuts(images, cuts)
        manifest = dict(release.manifest) | {"version": version, "created": created}
        manifest["cutouts"] = _summary(release, settings, cuts) | {"sha256": sha256(extras / TABLE)}
        return publish_release(out, tables, manifest, extras)


def _pixels(image: Any) -> tuple[RGB, Any | None]:
    """(h, w, 3) upright pixels of at most `MAX_SIDE_PX` to a side, over white, and the file's own alpha as a mask."""
    import numpy as np
    from PIL import Image, ImageOps

    upright = ImageOps.exif_transpose(image)
    upright.thumbnail((MAX_SIDE_PX, MAX_SIDE_PX), Image.Resampling.LANCZOS, reducing_gap=2.0)
    rgba = upright.convert("RGBA")
    alpha = np.asarray(rgba.getchannel("A"))
    white = Image.new("RGBA", rgba.size, (255, 255, 255, 255))
    picture = np.asarray(Image.alpha_composite(white, rgba).convert("RGB"))
    return picture, alpha if (alpha < 128).mean() >= CLEAR_SHARE else None


def _png(rgba: Any, box: tuple[int, int, int, int]) -> bytes:
    """The box of an RGBA image as PNG, its clear pixels black, so that it packs well and shows no background."""
    import numpy as np
    from PIL import Image

    x, y, width, height = box
    crop = np.array(rgba[y : y + height, x : x + width])
    crop[crop[..., 3] == 0] = 0
    sink = BytesIO()
    Image.fromarray(crop).save(sink, "PNG", compress_level=4)
    return sink.getvalue()


def _cut_batch(batch: Sequence[tuple[str, bytes]], settings: Settings) -> list[Cut]:
    import cv2

    cv2.setNumThreads(1)  # the workers are the threads
    return [cut(image_id, body, settings) for image_id, body in batch]


def _write_cuts(cuts: Sequence[Cut], extras: Path) -> list[Cut]:
    """The cuts with their PNGs in files; a file that a killed run left half is written again."""
    done = []
    for one in cuts:
        if one.png:
            file = inside(extras, f"{FOLDER}/{one.image_id[:2]}/{one.image_id}.png")  # an id is a text of the release's
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(one.png)
            path = file.relative_to(extras).as_posix()
            done.append(replace(one, png=b"", cutout_path=path, cutout_sha256=sha256(file)))
        else:
            done.append(one)
    return done


def _files(release: Release, images: pa.Table) -> dict[str, Path]:
    """File of each image, by its id, in the order of the ids."""
    rows = images.select(["image_id", "path"]).to_pylist()
    paths = {row["image_id"]: path for row in rows if (path := image_path(release.directory, row)) is not None}
    return dict(sorted(paths.items()))


def _batches(paths: Mapping[str, Path]) -> Iterator[list[tuple[str, bytes]]]:
    """Ids and bytes, so that a worker on another machine needs no disk of ours."""
    ids = list(paths)
    for first in range(0, len(ids), PICTURES_PER_CALL):
        yield [(image_id, paths[image_id].read_bytes()) for image_id in ids[first : first + PICTURES_PER_CALL]]


def _table(cuts: Sequence[Cut]) -> pa.Table:
    return pa.Table.from_pylist([asdict(one) for one in cuts], schema=CUTOUTS)


def _images_with_cuts(images: pa.Table, cuts: Sequence[Cut]) -> pa.Table:
    """The images table with path, share and method of the cuts."""
    known = {one.image_id: one for one in cuts}
    rows = images.to_pylist()
    for row in rows:
        one = known.get(row["image_id"])
        if one is not None:
            row |= {"cutout_path": one.cutout_path, "foreground_share": one.foreground_share, "method": one.method}
    return pa.Table.from_pylist(rows, schema=IMAGES)


def _summary(release: Release, settings: Settings, cuts: Sequence[Cut]) -> dict[str, Any]:
    return {
        "of": {"name": release.manifest["name"], "version": release.manifest["version"]},
        "backend": settings.name,
        "guides": len(settings.drawn),
        "model": settings.model if settings.name == "rembg" or settings.weights else None,
        "pictures": len(cuts),
        "cut": dict(sorted(Counter(one.method or "" for one in cuts if not one.set_aside).items())),
        "set_aside": dict(sorted(Counter(one.set_aside for one in cuts if one.set_aside).items())),
    }


def _model_sha(settings: Settings) -> str:
    path = Path(settings.model)
    return sha256(path) if path.suffix == ".onnx" and path.is_file() else ""


def _code() -> list[Path]:
    return sorted(Path(__file__).parent.glob("*.py"))
