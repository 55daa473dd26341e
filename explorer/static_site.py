"""The static site: every page and record as a file, for any web host and for browsers without a server."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from explorer.catalogue import ReleaseCatalogue
from explorer.routes import render, site_addresses
from metric_base.executors import end_with_parent
from metric_base.files import whole_folder
from metric_tree.release.images import link_images
from metric_tree.tree import Tree, open_tree

#: Number of addresses of a job of a worker process.
CHUNK = 400


@dataclass(frozen=True, slots=True)
class SiteSize:
    """Number of files of a site and their total size in bytes, images included."""

    files: int
    bytes: int


def write_site(out: Path, trees: Sequence[Tree], workers: int | None = None) -> SiteSize:
    """Write the site of releases into a new folder: the first at the root, the others under `releases/VERSION/`.

    Raises
    ------
    InputError
        `out` exists, or two releases have the same version.
    """
    workers = workers or os.cpu_count() or 1
    with whole_folder(out, "OUT") as work:
        for place, tree in enumerate(trees):
            folder = work / "releases" / tree.version if place else work
            catalogue = ReleaseCatalogue(trees, place)
            addresses = list(site_addresses(catalogue))
            for parent in {(folder / address).parent for address in addresses}:
                parent.mkdir(parents=True, exist_ok=True)
            link_images(tree.release, folder)
            chunks = [addresses[start : start + CHUNK] for start in range(0, len(addresses), CHUNK)]
            if workers == 1 or len(chunks) == 1:
                _worker["catalogue"] = catalogue
                for chunk in chunks:
                    _write(folder, chunk)
                continue
            # spawn, not fork: the threads of Arrow do not survive a fork
            directories = [tree.release.directory for tree in trees]
            with ProcessPoolExecutor(workers, get_context("spawn"), _start_worker, (directories, place)) as pool:
                for written in [pool.submit(_write, folder, chunk) for chunk in chunks]:
                    written.result()
        sizes = [path.stat().st_size for path in work.rglob("*") if path.is_file()]
    return SiteSize(len(sizes), sum(sizes))


_worker: dict[str, ReleaseCatalogue] = {}


def _start_worker(directories: Sequence[Path], place: int) -> None:
    end_with_parent()
    _worker["catalogue"] = ReleaseCatalogue([open_tree(directory) for directory in directories], place)


def _write(folder: Path, addresses: Sequence[str]) -> None:
    for address in addresses:
        rendered = render(_worker["catalogue"], address)
        if rendered is not None:
            (folder / address).write_bytes(rendered)
