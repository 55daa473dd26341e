"""Images of items: from a crawl into a release, and from a release back into memory.

Files are content-addressed (`pictures/aa/<sha256>.jpg`) and not packed into shards: an image shown by two items or two
releases lies once (releases link to it), one node's images are read without the others', and a removed image takes
nothing with it. `images.parquet` is the index; sorted by node, so that a node's rows are few row groups.

A release that is built, published or downloaded contains its images. The shipped releases and raw items share one
store, `data/images/aa/<sha256>.webp`. `stored_file` finds an image in either place.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from crawler.fetch.item_images import SCHEMA as PICTURE
from metric_base.errors import expect, in_file
from metric_base.records import json_record
from metric_tree.release.release import BadRelease, Release, link_file, sha256
from metric_tree.release.schema import IMAGES

#: Where images lie inside a release, as inside a crawl.
FOLDER = "pictures"

#: Folder of the images that shipped releases and raw items share, in the same layout as `pictures`.
STORE = "images"

#: Segments of image records (`crawler.fetch.crawl`).
_SEGMENT = re.compile(r"pictures-\d+-\d+\.jsonl")

#: The only paths that a record may name, and those of the store: what `crawler.fetch.item_images` writes.
_STORED = re.compile(r"([0-9a-f]{2})/(?P<id>\1[0-9a-f]{62})\.(jpg|png|webp)")

_STRINGS = ("image_id", "item_id", "source_url", "path")


@dataclass(frozen=True, slots=True, eq=False)
class Gathered:
    """rows : a table of `metric_tree.release.schema.IMAGES`; refused : images left out, by reason."""

    rows: pa.Table
    refused: Mapping[str, int]


def picture_files(paths: Iterable[Path]) -> list[Path]:
    """The image records in the given folders and all below them, and right beside the given files."""
    pattern = "pictures-*.jsonl"
    files = {
        file: None
        for path in paths
        for file in sorted(path.rglob(pattern) if path.is_dir() else path.parent.glob(pattern))
    }
    return [file for file in files if _SEGMENT.fullmatch(file.name)]


def collect_pictures(files: Sequence[Path], items: pa.Table, folder: Path) -> Gathered:
    """The images of the items of a release, their files linked into `folder`.

    An image takes the licence of its item: its source's terms, unless its record states its own, as that of a
    photograph does which shows the kind and hangs on the kind's range. Left out are images
    of items that the release does not show (`no_item`), without a file (`no_file`), and whose bytes are not those that
    their name says (`changed`).

    Raises
    ------
    InputError
        A line is no image record.
    """
    records = list(_records(files))
    wanted = pa.array({record["item_id"] for _, record in records}, pa.string())
    shown = items.filter(pc.is_in(items["item_id"], value_set=wanted)).select(["item_id", "node_id", "licence"])
    known = {row["item_id"]: row for row in shown.to_pylist()}
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    refused: dict[str, int] = {}
    for home, record in records:
        reason = _take(home, record, known, folder)
        if reason is not None:
            refused[reason] = refused.get(reason, 0) + 1
            continue
        path = f"{FOLDER}/{record['path']}"
        own = {name: record[name] for name in ("licence", "method") if record.get(name)}
        rows[record["image_id"], record["item_id"]] = (
            record | known[record["item_id"]] | {"method": "rendered"} | own | _files(record, path)
        )
    ordered = sorted(rows.values(), key=lambda row: (row["node_id"], row["item_id"], row["image_id"]))
    return Gathered(pa.Table.from_pylist(ordered, schema=IMAGES), refused)


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
    folder : folder of the release or the crawl.
    name : path relative to the folder, such as `pictures/aa/<sha256>.webp`.

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
            link_file(file, link)


def _files(record: Mapping[str, Any], path: str) -> dict[str, Any]:
    """The columns about the file; an image with an exact mask in it is its own cut-out."""
    if record.get("foreground_share") is None:
        return {"path": path, "method": None}
    return {"path": path, "cutout_path": path}


def _take(home: Path, record: Mapping[str, Any], known: Mapping[str, Any], folder: Path) -> str | None:
    if record["item_id"] not in known:
        return "no_item"
    name = f"{FOLDER}/{record['path']}"
    source, target = stored_file(home, name), folder / name
    if target.exists():
        return None
    if source is None:
        return "no_file"
    if sha256(source) != record["image_id"]:
        return "changed"
    target.parent.mkdir(parents=True, exist_ok=True)
    link_file(source, target)
    return None


def _records(files: Iterable[Path]) -> Iterator[tuple[Path, dict[str, Any]]]:
    for path in files:
        with path.open("rb") as lines:
            for number, line in enumerate(lines, start=1):
                with in_file(f"{path}:{number}"):
                    record = json_record(line, dict[str, Any])
                    _check_record(record)
                yield path.parent, record


def _check_record(record: Mapping[str, Any]) -> None:
    """FieldError where a field of an image's record is not what it must be."""
    expect(record.get("schema") == PICTURE, "schema", PICTURE, record.get("schema"))
    for name in _STRINGS:
        expect(isinstance(record.get(name), str), name, "a string", record.get(name))
    match = _STORED.fullmatch(record["path"])
    stored = match is not None and match["id"] == record["image_id"]
    expect(stored, "path", "aa/<image_id>.jpg, .png or .webp", record["path"])
    for name in ("width_px", "height_px"):
        number = record.get(name)
        expect(isinstance(number, int) and 0 < number < 1 << 20, name, "pixels", number)
    for name in ("pixels_per_metre", "foreground_share"):
        number = record.get(name, 1.0)
        expect(isinstance(number, float | int) and number > 0, name, "a positive number", number)
    for name in ("attribution", "licence", "method"):
        expect(isinstance(record.get(name), str | None), name, "a string", record.get(name))
