"""`metric-tree cutout RELEASE --out DIR`: foreground masks for the images of a release."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace

from metric_base.errors import InputError
from metric_base.executors import executor_of
from metric_cli.parser import input_path, new_folder
from metric_cli.progress import progress_bars
from metric_cli.tables import print_result
from metric_tree.cutouts.backend import BACKENDS, Settings
from metric_tree.cutouts.guided import guides
from metric_tree.cutouts.quality import REASONS
from metric_tree.cutouts.release_cutouts import cut_release
from metric_tree.release.registry import release_directory
from metric_tree.release.release import open_release

HELP = "Write a new release with foreground cut-outs of the images of a release."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("release", metavar="RELEASE", help="folder or version of a release with images")
    add("--out", metavar="DIR", type=new_folder, required=True, help="folder of the new release; it must not exist")
    add("--backend", choices=BACKENDS, default="auto", help="method (default: %(default)s)")
    add("--model", default="u2net", help="open model of rembg, or an ONNX file (default: %(default)s)")
    add("--download", action="store_true", help="download the weights of the model if the cache lacks them")
    add("--guide", type=input_path, metavar="FILE", help="boxes, polygons and scribbles of annotators (JSON Lines)")
    add("--version", help="version of the new release (default: that of the old one, with +cutouts)")
    add("--workers", type=int, default=os.cpu_count() or 1, help="number of processes (default: %(default)s)")
    add("--scheduler", metavar="ADDRESS", help="a Dask scheduler instead of processes; its workers share the folders")


def run(arguments: argparse.Namespace) -> None:
    """Write the release with cut-outs and print their counts."""
    release = open_release(release_directory(arguments.release))
    settings = backend_settings(arguments.backend, arguments.model, arguments.download)
    if arguments.guide:
        settings = replace(settings, drawn=tuple(guides(arguments.guide).values()))
    manifest = release.manifest
    with executor_of(arguments.workers, arguments.scheduler) as executor, progress_bars() as progress:
        cut = cut_release(
            release,
            arguments.out,
            settings,
            version=arguments.version or f"{manifest['version'].partition('+')[0]}+cutouts",
            created=manifest["created"],
            executor=executor,
            progress=lambda done, total: progress("cut", done, total),
        )
    summary = cut.manifest["cutouts"]
    rows = [(f"cut: {method}", count, "") for method, count in summary["cut"].items()]
    rows += [(f"set aside: {reason}", count, REASONS[reason]) for reason, count in summary["set_aside"].items()]
    record = {"schema": "metric-tree/cutouts/1", "directory": str(cut.directory), **summary}
    title = f"{cut.directory}: {summary['pictures']} pictures"
    print_result(arguments.json, record, ["pictures", "count", "why"], rows, title)


def backend_settings(name: str, model: str, download: bool) -> Settings:
    """Return the settings of a backend; check for the weights of a network before any work starts.

    Raises
    ------
    InputError
        The backend needs weights that are not available.
    """
    if name == "plain":
        return Settings("plain")
    from metric_tree.cutouts.network import Network, has_weights

    is_available = has_weights(model)
    if not is_available and download:
        Network.load(model)
        is_available = True
    if name == "rembg" and not is_available:
        raise InputError(
            f"--model {model}: expected rembg and its weights on this machine; found none"
            " (`--download` fetches them, `--backend plain` needs none)"
        )
    if not is_available:
        sys.stderr.write(f"metric-tree cutout: no weights of {model} here: only plain backgrounds are cut\n")
    return Settings("rembg" if name == "rembg" else "auto", model, is_available)
