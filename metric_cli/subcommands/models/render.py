"""`metric-tree render RAW --models DIR --out DIR`: images of items that have a textured model."""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from io import BytesIO

from metric_base.errors import InputError
from metric_base.files import write_whole
from metric_cli.parser import input_path, output_folder
from metric_cli.progress import track
from metric_cli.tables import print_result

HELP = "Render four views of the textured model of each item, with exact masks, in the layout that `build` reads."

#: Longest diagonal of a model in pixels; an image has about 3 kB, and the object is recognisable.
MODEL_DIAGONAL_PX = 256
#: Quality of WebP without visible artefacts at edges of this size.
WEBP_QUALITY = 70
#: Environment variable of Mesa for the threads of its software renderer, which are slower for images of this size.
THREADS = "LP_NUM_THREADS"
#: Flags of items that are not rendered, because an image would show a brand.
EXCLUDED_FLAGS = frozenset({"trademark"})


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("raw", metavar="RAW", type=input_path, help="raw items whose ids are paths of models (.glb) in --models")
    add("--models", metavar="DIR", type=input_path, required=True, help="folder of the models")
    add("--out", metavar="DIR", type=output_folder, required=True, help="folder of images and records, that of RAW")


def run(arguments: argparse.Namespace) -> None:
    """Render the models of all items and print the number of images."""
    from PIL import Image

    from crawler.fetch.item_images import Picture, picture
    from crawler.items import raw_items
    from insertion.render.gpu import gl_context
    from insertion.render.studio import studio_views
    from models3d.gltf.model_reader import read_model

    items = [item for item in raw_items(arguments.raw) if not EXCLUDED_FLAGS & set(item.flags)]
    files = [(item, arguments.models / item.source_id) for item in items]
    files = [(item, file) for item, file in files if file.suffix == ".glb" and file.is_file()]
    if not files:
        raise InputError(f"{arguments.models}: expected models that the ids of {arguments.raw} name; found none")
    os.environ.setdefault(THREADS, "1")
    context = gl_context()
    lines = []
    for item, file in track(files, "render", len(files)):
        for view in studio_views(context, read_model(file), MODEL_DIAGONAL_PX):
            body = BytesIO()
            Image.fromarray(view.rgba, "RGBA").save(body, "WEBP", quality=WEBP_QUALITY)
            name = f"{item.source}:{item.source_id}"
            stored = picture(body.getvalue(), item.url or "", name, arguments.out / "pictures")
            if isinstance(stored, Picture):  # an image of less than 64 pixels is rejected
                record = replace(
                    stored,
                    attribution=item.attribution,
                    pixels_per_metre=round(view.pixels_per_metre, 3),
                    foreground_share=round(view.foreground_share, 6),
                )
                lines.append(f"{record.line()}\n")
    write_whole(arguments.out / "pictures-000001-000001.jsonl", "".join(lines), "--out")
    counts = {"items": len(files), "pictures": len(lines)}
    print_result(arguments.json, {"schema": "metric-tree/render/1", **counts}, ["", "number"], counts.items())
