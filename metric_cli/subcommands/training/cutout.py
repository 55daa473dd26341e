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
from metric_cli.tables import print_json, print_table
from metric_tree.cutouts.backend import BACKENDS, Settings
from metric_tree.cutouts.guided import guides
from metric_tree.cutouts.quality import REASONS
from metric_tree.cutouts.release_cutouts import cut_release
from metric_tree.release.registry import release_directory
from metric_tree.release.release import Release, open_release

HELP = "Foreground cut-outs of a release's pictures, as a new release; the old one is not changed."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("release", metavar="RELEASE", help="folder or version of a release with pictures")
    add("--out", metavar="DIR", type=new_folder, required=True, help="the new release; it must not exist yet")
    add("--backend", choices=BACKENDS, default="auto", help="how to cut (default: %(default)s)")
    add("--model", default="u2net", help="open model that rembg knows, or an ONNX file (default: %(default)s)")
    add("--download", action="store_true", help="fetch the model's weights if the cache lacks them")
    add("--guide", type=input_path, metavar="FILE", help="boxes, polygons and scribbles of persons, JSON lines")
    add("--version", help="version of the new release (default: the old one's, with +cutouts)")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes (default: %(default)s)")
    add("--scheduler", metavar="ADDRESS", help="a Dask scheduler, in place of processes")


def run(arguments: argparse.Namespace) -> int:
    """Cut and print what came of it."""
    release = open_release(release_directory(arguments.release))
    settings = _settings(arguments.backend, arguments.model, arguments.download)
    if arguments.guide:
        settings = replace(settings, drawn=tuple(guides(arguments.guide).values()))
    manifest = release.manifest
    with executor_of(arguments.workers, arguments.scheduler) as executor, progress_bars() as shown:
        made = cut_release(
            release,
            arguments.out,
            settings,
            version=arguments.version or f"{manifest['version'].partition('+')[0]}+cutouts",
            created=manifest["created"],
            executor=executor,
            progress=lambda done, total: shown("cut", done, total),
        )
    _print(made, arguments.json)
    return 0


def _settings(name: str, model: str, download: bool) -> Settings:
    """The backend as asked for; a network's weights are looked for here, before any work is handed out."""
    if name == "plain":
        return Settings("plain")
    from metric_tree.cutouts.network import Network, has_weights

    at_hand = has_weights(model)
    if not at_hand and download:
        Network.load(model)
        at_hand = True
    if name == "rembg" and not at_hand:
        raise InputError(
            f"--model {model}: expected rembg and its weights on this machine; found none"
            " (`--download` fetches them, `--backend plain` needs none)"
        )
    if not at_hand:
        sys.stderr.write(f"metric-tree cutout: no weights of {model} here: only plain backgrounds are cut\n")
    return Settings("rembg" if name == "rembg" else "auto", model, at_hand)


def _print(release: Release, as_json: bool) -> None:
    summary = release.manifest["cutouts"]
    if as_json:
        print_json({"schema": "metric-tree/cutouts/1", "directory": str(release.directory), **summary})
        return
    rows = [(f"cut: {method}", count, "") for method, count in summary["cut"].items()]
    rows += [(f"set aside: {reason}", count, REASONS[reason]) for reason, count in summary["set_aside"].items()]
    print_table(["pictures", "count", "why"], rows, title=f"{release.directory}: {summary['pictures']} pictures")
