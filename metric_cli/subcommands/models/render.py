"""`metric-tree render RAW --models DIR --out DIR`: images of items that have a textured model."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from metric_base.errors import InputError
from metric_base.files import whole_file
from metric_cli.parser import input_path, output_folder
from metric_cli.progress import with_bar
from metric_cli.tables import print_json, print_table

if TYPE_CHECKING:
    from crawler.fetch.item_images import Picture
    from crawler.items import RawItem

HELP = "Four views of each item's textured model, with exact foreground, where `build` looks for pictures."

#: Longest diagonal of a model in pixels: an image is some 3 kB, and an object can be recognised.
PIXELS = 256
#: WebP quality at which edges show no blocks at this size.
QUALITY = 70
#: Mesa's variable for the threads of its software renderer: on images this small they wait more than they work.
THREADS = "LP_NUM_THREADS"
#: Flags of items that are not drawn: an image would show a brand.
NOT_SHOWN = frozenset({"trademark"})


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument(
        "raw", metavar="RAW", type=input_path, help="raw items whose ids are paths of models (.glb) in --models"
    )
    parser.add_argument("--models", metavar="DIR", type=input_path, required=True, help="the folder of the models")
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=output_folder,
        required=True,
        help="where pictures and their records are written: beside RAW",
    )


def run(arguments: argparse.Namespace) -> int:
    """Draw all models of the items, and print how many images there are."""
    from crawler.items import raw_items
    from insertion.render.gpu import gl_context

    items = [item for item in raw_items(arguments.raw) if not NOT_SHOWN & set(item.flags)]
    drawn = [item for item in items if (arguments.models / item.source_id).suffix == ".glb"]
    drawn = [item for item in drawn if (arguments.models / item.source_id).is_file()]
    if not drawn:
        raise InputError(f"{arguments.models}: expected models that the ids of {arguments.raw} name; found none")
    folder = arguments.out / "pictures"
    os.environ.setdefault(THREADS, "1")
    context = gl_context()
    pictures = [
        picture
        for item in with_bar(drawn, "render", len(drawn))
        for picture in _pictures(context, item, arguments.models, folder)
    ]
    with whole_file(arguments.out / "pictures-000001-000001.jsonl", "--out") as work:
        work.write_text("".join(f"{picture.line()}\n" for picture in pictures), encoding="utf-8")
    counts = {"items": len(drawn), "pictures": len(pictures)}
    if arguments.json:
        print_json({"schema": "metric-tree/render/1", **counts})
    else:
        print_table(["", "number"], list(counts.items()))
    return 0


def _pictures(context: Any, item: RawItem, models: Path, folder: Path) -> Iterator[Picture]:
    """The stored views of one item; a model with no area, seen from any side, has none."""
    from dataclasses import replace

    from crawler.fetch.item_images import Picture, picture
    from insertion.render.studio import studio_views
    from models3d.gltf.model_reader import read_model

    for view in studio_views(context, read_model(models / item.source_id), PIXELS):
        stored = picture(_webp(view.rgba), item.url or "", f"{item.source}:{item.source_id}", folder)
        if isinstance(stored, Picture):  # a sliver of under 64 pixels is refused
            yield replace(
                stored,
                attribution=item.attribution,
                pixels_per_metre=round(view.pixels_per_metre, 3),
                foreground_share=round(view.foreground_share, 6),
            )


def _webp(rgba: Any) -> bytes:
    from PIL import Image

    body = BytesIO()
    Image.fromarray(rgba, "RGBA").save(body, "WEBP", quality=QUALITY)
    return body.getvalue()
