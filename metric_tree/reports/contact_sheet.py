"""Contact sheet of the images of a node at one scale, with a scale bar.

The longer side of the box of a cut-out is as long as the longest stated extent of its item. This is exact if the image
shows this side frontally, as most shop images do; an object seen over its corner is up to 30 % too small, one seen
along its longest side too large.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from textwrap import wrap
from typing import Any

from crawler.fetch.item_images import decode_image
from metric_base.errors import InputError
from metric_base.files import output_file, whole_file
from metric_base.length_units import bar_length
from metric_tree.node import Node
from metric_tree.release.images import image_path

#: Width of the sheet, its margin, the gap between objects, and the height of the two lines of a label, in pixels.
WIDTH, MARGIN, GAP, LABEL_HEIGHT = 1600, 40, 30, 46

#: Longer side of the largest object in pixels.
MAX_SIDE_PX = 340

#: Minimum longer side of an object in pixels, so that it remains visible.
MIN_SIDE_PX = 3

#: Height of a line of credits in pixels, and its maximum number of characters.
CREDIT_HEIGHT, MAX_CREDIT_CHARS = 20, 190

#: Minimum width of a column in pixels, for its label.
COLUMN_PX = 150

#: Maximum number of characters of a title.
MAX_TITLE_CHARS = 20


@dataclass(frozen=True, slots=True, eq=False)
class Tile:
    """An image to draw."""

    path: Path
    is_cut: bool  #: Whether the file is a cut-out.
    longest_mm: float  #: Longest extent of the item, the longer side of images without `pixels_per_mm`.
    pixels_per_mm: float | None  #: Scale of a rendered image.
    title: str
    sizes: str
    credit: str


def image_rows(node: Node, count: int) -> list[dict[str, Any]]:
    """Return at most `count` images of a node with the fields of their items: cut-outs first, spread over the sizes."""
    import pyarrow.compute as pc

    images, items = node.images(), node.items()
    shown = items.filter(pc.is_in(items["item_id"], value_set=images["item_id"])).to_pylist()
    known = {row["item_id"]: row for row in shown if row["extents_mm"]}
    rows = [{**known[row["item_id"]], **row} for row in images.to_pylist() if row["item_id"] in known]
    first = spread_rows([row for row in rows if row["cutout_path"]], count)
    return first + spread_rows([row for row in rows if not row["cutout_path"]], count - len(first))


def spread_rows(rows: list[dict[str, Any]], count: int) -> list[dict[str, Any]]:
    """Return at most `count` rows, evenly over the order of longest extents; each item once, if there are enough."""
    if not rows or count <= 0:
        return []
    ordered = sorted(rows, key=lambda row: (max(row["extents_mm"]), row["item_id"], row["image_id"]))
    firsts = list({row["item_id"]: row for row in reversed(ordered)}.values())[::-1]
    if count > len(firsts):
        shown = {row["image_id"] for row in firsts}
        return firsts + spread_rows([row for row in ordered if row["image_id"] not in shown], count - len(firsts))
    return [firsts[(2 * k + 1) * len(firsts) // (2 * count)] for k in range(count)]


def tiles(release: Path, rows: Sequence[Mapping[str, Any]]) -> list[Tile]:
    """Return the rows whose file is an image, with the cut-out if there is one."""
    tiles = []
    for row in rows:
        cut = image_path(release, row, "cutout_path")
        path = cut or image_path(release, row)
        if path is not None and (cut or not isinstance(decode_image(path.read_bytes()), str)):
            sizes = " × ".join(f"{side:.0f}" for side in row["extents_mm"])
            credit = row["attribution"] or f"{row['source']} ({row['licence'] or 'no licence stated'})"
            scale = row["pixels_per_metre"] / 1000 if cut and row["pixels_per_metre"] else None
            longest = max(row["extents_mm"])
            tiles.append(Tile(path, cut is not None, longest, scale, row["title"], f"{sizes} mm", credit))
    return tiles


def write_sheet(file: Path, node: Node, count: int) -> list[dict[str, Any]]:
    """Draw at most `count` images of a node into a PNG, and return their rows.

    Raises
    ------
    InputError
        No image of the node has an item with a size, or the name of the file does not end in `.png`.
    """
    if file.suffix.lower() != ".png":
        raise InputError(f"--sheet: expected a name that ends in .png; found {file}")
    output_file(file, "--sheet")
    rows = image_rows(node, count)
    shown = tiles(node.tree.release.directory, rows)
    if not shown:
        raise InputError(f"{node.node_id}: expected pictures of items with a size; found none")
    image = sheet_image(shown, f"{node.name}: {len(shown)} of {node.images().num_rows} pictures, to one scale")
    with whole_file(file, "--sheet") as work:
        image.save(work, "PNG")
    return rows


def sheet_image(shown: Sequence[Tile], title: str) -> Any:
    """Draw the sheet as a Pillow image: title, scale bar, shelves of objects with labels, credits."""
    from PIL import Image, ImageDraw

    mm_per_px = max(tile.longest_mm for tile in shown) / MAX_SIDE_PX
    scaled = [scaled_image(tile, mm_per_px) for tile in shown]

    # 1. Shelves of (index, x), filled from the left in the given order.
    shelves: list[list[tuple[int, int]]] = [[]]
    x = MARGIN
    for index, image in enumerate(scaled):
        column = max(image.width, COLUMN_PX)
        if shelves[-1] and x + column > WIDTH - MARGIN:
            shelves.append([])
            x = MARGIN
        shelves[-1].append((index, x))
        x += column + GAP
    heights = [max(scaled[index].height for index, _ in shelf) + LABEL_HEIGHT + GAP for shelf in shelves]
    note = "" if all(tile.is_cut for tile in shown) else " Framed: not cut, the frame is drawn as the object."
    credit_lines = wrap(f"Pictures: {'; '.join(sorted({tile.credit for tile in shown}))}.{note}", MAX_CREDIT_CHARS)

    # 2. Title and scale bar.
    top = 2 * MARGIN + 50
    sheet = Image.new("RGB", (WIDTH, top + sum(heights) + 40 + CREDIT_HEIGHT * len(credit_lines)), "white")
    pen = ImageDraw.Draw(sheet)
    pen.text((MARGIN, MARGIN), title, fill="black", font=_font(26))
    length = bar_length(mm_per_px)
    y, end = MARGIN + 50, MARGIN + round(length / mm_per_px)
    pen.line((MARGIN, y, end, y), fill="black", width=3)
    for tick in (MARGIN, end):
        pen.line((tick, y - 7, tick, y + 7), fill="black", width=3)
    text = f"{length:g} mm" if length < 10 else f"{length / 10:g} cm" if length < 1000 else f"{length / 1000:g} m"
    pen.text((end + 12, y - 10), text, fill="black", font=_font(18))

    # 3. Objects with their labels, and credits.
    y = top
    for shelf, height in zip(shelves, heights, strict=True):
        floor = y + height - LABEL_HEIGHT - GAP
        for index, x in shelf:
            name = shown[index].title
            name = name if len(name) <= MAX_TITLE_CHARS else f"{name[: MAX_TITLE_CHARS - 1]}…"
            sheet.paste(scaled[index], (x, floor - scaled[index].height), scaled[index])
            pen.text((x, floor + 6), name, fill="black", font=_font(14))
            pen.text((x, floor + 24), shown[index].sizes, fill="#555555", font=_font(14))
        pen.line((MARGIN, floor + 2, WIDTH - MARGIN, floor + 2), fill="#dddddd")
        y += height
    for index, line in enumerate(credit_lines):
        pen.text((MARGIN, y + 10 + CREDIT_HEIGHT * index), line, fill="#555555", font=_font(14))
    return sheet


def scaled_image(tile: Tile, mm_per_px: float) -> Any:
    """Return the RGBA image of a tile at the scale of the sheet; an image that is not a cut-out has a frame."""
    from PIL import Image, ImageOps

    with Image.open(tile.path, formats=["PNG", "JPEG", "WEBP"]) as file:
        image = ImageOps.exif_transpose(file).convert("RGBA")
    shown_mm = max(image.size) / tile.pixels_per_mm if tile.pixels_per_mm else tile.longest_mm
    factor = max(shown_mm / mm_per_px, MIN_SIDE_PX) / max(image.size)
    size = (max(1, round(image.width * factor)), max(1, round(image.height * factor)))
    small = image.resize(size, Image.Resampling.LANCZOS)
    return small if tile.is_cut else ImageOps.expand(small, 1, "#cc8844")


@cache
def _font(size: int) -> Any:
    """Load DejaVu Sans of matplotlib, which is the same on every machine and has most scripts."""
    from PIL import ImageFont

    library = find_spec("matplotlib")  # not imported, which takes half a second
    if library is None or library.origin is None:
        return ImageFont.load_default(size)
    return ImageFont.truetype(Path(library.origin).parent / "mpl-data/fonts/ttf/DejaVuSans.ttf", size)
