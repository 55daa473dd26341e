"""Contact sheet of a node's images, all to one scale, with a size bar: appearance and size together.

The longer side of a cut-out's box is drawn as long as the longest stated extent of its item. That is exact where the
image looks square at that side, as most shop images do; an object seen over its corner is drawn up to three tenths
too small, one seen along its longest side too large.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from textwrap import wrap
from typing import Any

from crawler.fetch.item_images import decode_picture
from metric_base.errors import InputError
from metric_base.files import output_file, whole_file
from metric_tree.node import Node
from metric_tree.release.images import image_path

#: Sheet in pixels: width, margin, gap between objects, height of the two lines under an object.
WIDTH, MARGIN, GAP, LABEL = 1600, 40, 30, 46

#: Pixels of the largest object's longer side, and the least that an object keeps, so that it is seen at all.
LARGEST, LEAST = 340, 3

#: Pixels of a line of credits, and letters that fit into it.
CREDIT_HEIGHT, CREDIT_LETTERS = 20, 190

#: Columns that a label needs, however small its object.
COLUMN_PX = 150


@dataclass(frozen=True, slots=True, eq=False)
class Tile:
    """An image to be drawn: its file, whether that is a cut-out, what its scale is known by, the label and the credit.

    `pixels_per_mm` is known of a rendered image; the longer side of any other counts as the object's longest extent.
    """

    path: Path
    is_cut: bool
    longest_mm: float
    pixels_per_mm: float | None
    title: str
    sizes: str
    credit: str


def picture_rows(node: Node, count: int) -> list[dict[str, Any]]:
    """Rows of at most `count` images of a node, each with its item's fields: cut ones first, spread over sizes."""
    import pyarrow.compute as pc

    images, items = node.images(), node.items()
    own = items.filter(pc.is_in(items["item_id"], value_set=images["item_id"])).to_pylist()
    known = {row["item_id"]: row for row in own if row["extents_mm"]}
    rows = [{**known[row["item_id"]], **row} for row in images.to_pylist() if row["item_id"] in known]
    cut = [row for row in rows if row["cutout_path"]]
    rest = [row for row in rows if not row["cutout_path"]]
    first = _spread(cut, count)
    return first + _spread(rest, count - len(first))


def tiles(release: Path, rows: Sequence[Mapping[str, Any]]) -> list[Tile]:
    """What of the rows can be drawn: those whose file is an image, cut-outs where there are any."""
    tiles = []
    for row in rows:
        cut = image_path(release, row, "cutout_path")
        path = cut or image_path(release, row)
        if path is not None and (cut or not isinstance(decode_picture(path.read_bytes()), str)):
            sizes = " × ".join(f"{side:.0f}" for side in row["extents_mm"])
            credit = row["attribution"] or f"{row['source']} ({row['licence'] or 'no licence stated'})"
            scale = row["pixels_per_metre"] / 1000 if cut and row["pixels_per_metre"] else None
            longest = max(row["extents_mm"])
            tiles.append(Tile(path, cut is not None, longest, scale, row["title"], f"{sizes} mm", credit))
    return tiles


def write_sheet(file: Path, node: Node, count: int) -> list[dict[str, Any]]:
    """Draw at most `count` images of a node into a PNG; the rows that are on it.

    Raises
    ------
    InputError
        The node has no images of items with a size, or the file's name does not end in `.png`.
    """
    if file.suffix.lower() != ".png":
        raise InputError(f"--sheet: expected a name that ends in .png; found {file}")
    output_file(file, "--sheet")
    rows = picture_rows(node, count)
    shown = tiles(node.tree.release.directory, rows)
    if not shown:
        raise InputError(f"{node.node_id}: expected pictures of items with a size; found none")
    image = _sheet(shown, f"{node.name}: {len(shown)} of {node.images().num_rows} pictures, to one scale")
    with whole_file(file, "--sheet") as work:
        image.save(work, "PNG")
    return rows


def bar_length(mm_per_px: float, about_px: float = 200) -> float:
    """A round length in mm (1, 2 or 5 times a power of ten), the longest that is drawn in `about_px` at most."""
    most = mm_per_px * about_px
    power = 10.0 ** math.floor(math.log10(most))
    return max(one * power for one in (1, 2, 5) if one * power <= most)


def _spread(rows: list[dict[str, Any]], count: int) -> list[dict[str, Any]]:
    """At most `count` rows, evenly over the order of longest extents; a second view of an item after one of each."""
    if not rows or count <= 0:
        return []
    ordered = sorted(rows, key=lambda row: (max(row["extents_mm"]), row["item_id"], row["image_id"]))
    firsts = list({row["item_id"]: row for row in reversed(ordered)}.values())[::-1]
    if count > len(firsts):
        shown = {row["image_id"] for row in firsts}
        return firsts + _spread([row for row in ordered if row["image_id"] not in shown], count - len(firsts))
    return [firsts[(2 * k + 1) * len(firsts) // (2 * count)] for k in range(count)]


def _sheet(pictured: Sequence[Tile], title: str) -> Any:
    """The sheet as a Pillow image."""
    from PIL import Image, ImageDraw

    mm_per_px = max(tile.longest_mm for tile in pictured) / LARGEST
    scaled = [_scale(tile, mm_per_px) for tile in pictured]
    rows = _rows([picture.size for picture in scaled])
    heights = [max(scaled[k].height for k, _ in row) + LABEL + GAP for row in rows]
    owed = _credit_lines(pictured)
    top, foot = 2 * MARGIN + 50, 40 + CREDIT_HEIGHT * len(owed)
    sheet = Image.new("RGB", (WIDTH, top + sum(heights) + foot), "white")
    pen = ImageDraw.Draw(sheet)
    pen.text((MARGIN, MARGIN), title, fill="black", font=_font(26))
    _draw_bar(pen, mm_per_px)
    y = top
    for row, height in zip(rows, heights, strict=True):
        shelf = y + height - LABEL - GAP
        for k, x in row:
            sheet.paste(scaled[k], (x, shelf - scaled[k].height), scaled[k])
            pen.text((x, shelf + 6), _shorten(pictured[k].title), fill="black", font=_font(14))
            pen.text((x, shelf + 24), pictured[k].sizes, fill="#555555", font=_font(14))
        pen.line((MARGIN, shelf + 2, WIDTH - MARGIN, shelf + 2), fill="#dddddd")
        y += height
    for number, line in enumerate(owed):
        pen.text((MARGIN, y + 10 + CREDIT_HEIGHT * number), line, fill="#555555", font=_font(14))
    return sheet


def _credit_lines(pictured: Sequence[Tile]) -> list[str]:
    """Whom to name for the images, as their licences ask, in lines that fit on the sheet."""
    owed = "; ".join(sorted({tile.credit for tile in pictured}))
    note = "" if all(tile.is_cut for tile in pictured) else " Framed: not cut, the frame is drawn as the object."
    return wrap(f"Pictures: {owed}.{note}", CREDIT_LETTERS)


def _scale(tile: Tile, mm_per_px: float) -> Any:
    """The image at the sheet's scale, RGBA; one that is not cut has a frame."""
    from PIL import Image, ImageOps

    with Image.open(tile.path, formats=["PNG", "JPEG", "WEBP"]) as file:
        picture = ImageOps.exif_transpose(file).convert("RGBA")
    shown_mm = max(picture.size) / tile.pixels_per_mm if tile.pixels_per_mm else tile.longest_mm
    factor = max(shown_mm / mm_per_px, LEAST) / max(picture.size)
    size = (max(1, round(picture.width * factor)), max(1, round(picture.height * factor)))
    small = picture.resize(size, Image.Resampling.LANCZOS)
    return small if tile.is_cut else ImageOps.expand(small, 1, "#cc8844")


def _rows(sizes: Sequence[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    """Shelves of (number, x), filled from the left in the given order."""
    rows: list[list[tuple[int, int]]] = [[]]
    x = MARGIN
    for number, (width, _) in enumerate(sizes):
        column = max(width, COLUMN_PX)
        if rows[-1] and x + column > WIDTH - MARGIN:
            rows.append([])
            x = MARGIN
        rows[-1].append((number, x))
        x += column + GAP
    return rows


def _draw_bar(pen: Any, mm_per_px: float) -> None:
    length = bar_length(mm_per_px)
    x, y, end = MARGIN, MARGIN + 50, MARGIN + round(length / mm_per_px)
    pen.line((x, y, end, y), fill="black", width=3)
    for tick in (x, end):
        pen.line((tick, y - 7, tick, y + 7), fill="black", width=3)
    text = f"{length:g} mm" if length < 10 else f"{length / 10:g} cm" if length < 1000 else f"{length / 1000:g} m"
    pen.text((end + 12, y - 10), text, fill="black", font=_font(18))


def _shorten(text: str) -> str:
    return text if len(text) <= 20 else f"{text[:19]}…"


@cache
def _font(size: int) -> Any:
    """DejaVu Sans as matplotlib brings it: the same sheet on every machine, and titles in most scripts."""
    from PIL import ImageFont

    library = find_spec("matplotlib")  # found, not imported: its import takes half a second
    if library is None or library.origin is None:
        return ImageFont.load_default(size)
    return ImageFont.truetype(Path(library.origin).parent / "mpl-data/fonts/ttf/DejaVuSans.ttf", size)
