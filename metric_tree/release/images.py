"""Images of items: from a crawl into a release, and from a release back into memory.

Files have the SHA-256 of their bytes as name (`pictures/aa/<sha256>.jpg`) and are not packed: an image of two items or
two releases is stored once (releases hard-link it), the images of a node are read without the others, and one image can
be removed. `images.parquet` is the index, sorted by node, so that the rows of a node are in few row groups.

A release that is built, published or downloaded contains its images. The shipped releases and raw items share one
store, `data/images/aa/<sha256>.webp`. `stored_file` finds an image in either place.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from crawler.fetch.item_images import SCHEMA as PICTURE
from metric_base.errors import expect, in_file
from metric_base.operating_system import link_or_copy
from metric_base.records import json_record
from metric_tree.release.release import BadRelease, Release, sha256
from metric_tree.release.schema import IMAGES

#: Folder of the images in a release, as in a crawl.
FOLDER = "pictures"

#: Folder of the images that shipped releases and raw items share, in the same layout as `pictures`.
STORE = "images"

#: Name of a file of image records (`crawler.fetch.crawl`).
_SEGMENT = re.compile(r"pictures-\d+-\d+\.jsonl")

#: Paths that a record may name, and those of the store (`crawler.fetch.item_images`).
_STORED = re.compile(r"([0-9a-f]{2})/(?P<id>\1[0-9a-f]{62})\.(jpg|png|webp)")

#: Upper bound of the side of an image in pixels, far above any image of a crawl.
MAX_SIDE_PX = 1 << 20


@dataclass(frozen=True, slots=True, eq=False)
class CollectedImages:
    """Images of the items of a release."""

    rows: pa.Table  #: Rows of `metric_tree.release.schema.IMAGES`.
    refused: Mapping[str, int]  #: Number of other images by reason.


def image_record_files(paths: Iterable[Path]) -> list[Path]:
    """Return the files of image records in and below the given folders, and next to the given files."""
    pattern = "pictures-*.jsonl"
    found = (sorted(path.rglob(pattern) if path.is_dir() else path.parent.glob(pattern)) for path in paths)
    return [file for file in dict.fromkeys(chain(*found)) if _SEGMENT.fullmatch(file.name)]


def collect_images(files: Sequence[Path], items: pa.Table, folder: Path) -> CollectedImages:
    """Collect the images of published items and link their files into a release.

    Parameters
    ----------
    files : sequence of Path
        Files of image records (`image_record_files`). The image files are in `pictures/` next to them, or in the store.
    items : Table
        Published items with the columns `item_id`, `node_id` and `licence`.
    folder : Path
        Folder of the release. Image files are hard-linked (or copied) to `<folder>/pictures/<aa>/<sha256>.<ext>`.

    Returns
    -------
    CollectedImages
        `rows` has one row per image and item, sorted by node, item and image; images have the licence of their item
        unless the record states one. `refused` counts the other records by reason: `no_item` (not in `items`),
        `no_file` (file missing) or `changed` (the checksum differs from the name).

    Raises
    ------
    InputError
        A line is not a valid image record.
    """
    records: list[tuple[Path, dict[str, Any]]] = []
    for path in files:
        with path.open("rb") as lines:
            for number, line in enumerate(lines, start=1):
                with in_file(f"{path}:{number}"):
                    record = json_record(line, dict[str, Any])
                    check_image_record(record)
                records.append((path.parent, record))
    wanted = pa.array({record["item_id"] for _, record in records}, pa.string())
    shown = items.filter(pc.is_in(items["item_id"], value_set=wanted)).select(["item_id", "node_id", "licence"])
    published = {row["item_id"]: row for row in shown.to_pylist()}
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    refused: Counter[str] = Counter()
    for crawl, record in records:
        if record["item_id"] not in published:
            refused["no_item"] += 1
            continue
        name = f"{FOLDER}/{record['path']}"
        source, target = stored_file(crawl, name), folder / name
        if not target.exists():
            if source is None or sha256(source) != record["image_id"]:
                refused["no_file" if source is None else "changed"] += 1
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            link_or_copy(source, target)
        row = record | published[record["item_id"]] | {"method": "rendered"}
        row |= {column: record[column] for column in ("licence", "method") if record.get(column)}
        # An image with an exact mask is its own cut-out.
        row |= {"path": name} | ({"method": None} if record.get("foreground_share") is None else {"cutout_path": name})
        rows[record["image_id"], record["item_id"]] = row
    ordered = sorted(rows.values(), key=lambda row: (row["node_id"], row["item_id"], row["image_id"]))
    return CollectedImages(pa.Table.from_pylist(ordered, schema=IMAGES), dict(refused))


def check_image_record(record: Mapping[str, Any]) -> None:
    """Check the fields of an image record.

    Raises
    ------
    FieldError
        A field is missing or invalid.
    """
    expect(record.get("schema") == PICTURE, "schema", PICTURE, record.get("schema"))
    for name in ("image_id", "item_id", "source_url", "path"):
        expect(isinstance(record.get(name), str), name, "a string", record.get(name))
    match = _STORED.fullmatch(record["path"])
    is_stored = match is not None and match["id"] == record["image_id"]
    expect(is_stored, "path", "aa/<image_id>.jpg, .png or .webp", record["path"])
    for name in ("width_px", "height_px"):
        pixels = record.get(name)
        expect(isinstance(pixels, int) and 0 < pixels < MAX_SIDE_PX, name, "pixels", pixels)
    for name in ("pixels_per_metre", "foreground_share"):
        number = record.get(name, 1.0)
        expect(isinstance(number, float | int) and number > 0, name, "a positive number", number)
    for name in ("attribution", "licence", "method"):
        expect(isinstance(record.get(name), str | None), name, "a string", record.get(name))


def image_path(release: Path, row: Mapping[str, Any], column: str = "path") -> Path | None:
    """Return the file of a row's image (or `cutout_path`), None if it is neither in the release nor in the store."""
    return None if row[column] is None else stored_file(release, row[column])


def stored_file(folder: Path, name: str) -> Path | None:
    """Return the path of a file that a release or a crawl names.

    The file in the folder itself takes precedence. Otherwise an image is looked up in the shared store: the folder
    `images` next to the given folder or one level above, so that `data/raw` and `data/release/3.0.0` share
    `data/images`.

    Parameters
    ----------
    folder : Path
        Folder of the release or the crawl.
    name : str
        Path relative to the folder, such as `pictures/aa/<sha256>.webp`.

    Returns
    -------
    Path or None
        None if the file does not exist, or if it is outside the folder and the store.
    """
    whole = folder.resolve()
    places = [(whole, name)]
    parent, _, stored = name.partition("/")
    if parent == FOLDER and _STORED.fullmatch(stored):
        places += [(above / STORE, stored) for above in (whole.parent, whole.parent.parent)]
    for place, relative in places:
        path = place / relative
        if path.is_file() and path.resolve().is_relative_to(place.resolve()):
            return path
    return None


def image_files(release: Release) -> dict[str, Path]:
    """Return the files of all images that a release names below `pictures`, by name, cut-outs first.

    Raises
    ------
    BadRelease
        An image is neither in the release nor in the shared store.
    """
    table = release.table("images", columns=["cutout_path", "path"])
    names = [name for column in ("cutout_path", "path") for name in table[column].to_pylist() if name]
    files: dict[str, Path] = {}
    for name in dict.fromkeys(names):
        if name.startswith(f"{FOLDER}/") and ".." not in name:
            file = stored_file(release.directory, name)
            if file is None:
                raise BadRelease(f"{release.directory / name}: expected the file of an image; found none")
            files[name] = file
    return files


def link_images(release: Release, target: Path) -> None:
    """Link the images of a release into another folder under the same names; existing files are kept.

    Raises
    ------
    BadRelease
        An image is neither in the release nor in the shared store.
    """
    for name, file in image_files(release).items():
        link = target / name
        link.parent.mkdir(parents=True, exist_ok=True)
        if not link.exists():
            link_or_copy(file, link)
