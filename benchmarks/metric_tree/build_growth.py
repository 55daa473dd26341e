"""Time and memory of a build against its rows.

`python -m benchmarks.metric_tree.build_growth [--rows 10000 100000 1000000]`.

Raw items are made up: four hundred categories in the shape of a tree of five levels, sizes log-normal, a fifth of the
rows without depth, a tenth without words, a per cent repeated, a per mille in the wrong unit. The taxonomy matches by
name, so that what is measured is the build and not WordNet. With `--dask` the same build runs on a scheduler with
workers of their own over TCP on this machine.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

from crawler.items import RawItem
from taxonomy.categories import Category, Match

CATEGORIES = 400

#: Children of each inner node of the made tree: 400 leaves under 40, 8, 2 and the root.
FAN = (10, 5, 4, 2)

#: Rows made at a time.
BATCH = 10_000


class SyntheticTaxonomy:
    """Leaves `kind<number>` of a tree of five levels, matched by name."""

    def __init__(self) -> None:
        self._categories = list(_synthetic_categories())
        self._ids = {category.name: category.node_id for category in self._categories if category.level == 5}

    def categories(self) -> list[Category]:
        """All nodes, parents first."""
        return self._categories

    def match(self, item: RawItem) -> Match:
        """The leaf that the item's category names."""
        return Match(self._ids.get(item.category_path[-1]), 1.0, "name")


@cache
def synthetic_taxonomy() -> SyntheticTaxonomy:
    return SyntheticTaxonomy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--dask", action="store_true", help="a Dask scheduler and its workers over TCP")
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one is not None:
        print(json.dumps(_measured(arguments.folder, arguments.workers, arguments.dask)))
        return
    print(
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {arguments.workers} workers{', Dask' * arguments.dask}"
    )
    print("     rows    raw MB   wall s    cpu s   parent MB   worker MB   items of the fit   release MB")
    for rows in arguments.rows:
        folder = Path(tempfile.mkdtemp(prefix="growth-"))
        try:
            raw = _synthetic_raw(folder / "raw.jsonl", rows)
            found = _in_a_process_of_its_own(rows, folder, arguments)
            print(
                f"{rows:9d} {raw / 1e6:9.1f} {found['wall']:8.1f} {found['cpu']:8.1f} {found['parent_mb']:11.0f}"
                f" {found['worker_mb']:11.0f} {found['n_fit']:18d} {found['release_mb']:12.1f}",
                flush=True,
            )
        finally:
            shutil.rmtree(folder)


def _in_a_process_of_its_own(rows: int, folder: Path, arguments: argparse.Namespace) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.metric_tree.build_growth", "--one", str(rows), "--folder", str(folder)]
    command += ["--workers", str(arguments.workers)] + ["--dask"] * arguments.dask
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def _measured(folder: Path, workers: int, dask: bool) -> dict[str, float]:
    from metric_tree.build.steps import Options, build_release
    from metric_tree.commands.build import executor_of

    started = time.perf_counter()
    options = Options(version="0.0.0", created="2026-01-01", heldout=False)
    with _scheduler(workers, dask) as scheduler, executor_of(workers, scheduler) as executor:
        build = build_release(
            [folder / "raw.jsonl"],
            folder / "release",
            options,
            taxonomy=synthetic_taxonomy,
            declared={},
            executor=executor,
        )
    wall = time.perf_counter() - started
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    files = build.release.manifest["files"].values()
    return {
        "wall": wall,
        "cpu": own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime,
        "parent_mb": own.ru_maxrss / 1024,
        "worker_mb": children.ru_maxrss / 1024,
        "n_fit": build.release.manifest["counts"]["n_fit"],
        "release_mb": sum(file["bytes"] for file in files) / 1e6,
    }


class _scheduler:  # noqa: N801 - used like a function
    """The address of a local Dask cluster whose workers are processes, or None."""

    def __init__(self, workers: int, dask: bool) -> None:
        self._workers, self._dask = workers, dask

    def __enter__(self) -> str | None:
        if not self._dask:
            return None
        from distributed import LocalCluster

        self._cluster = LocalCluster(
            n_workers=self._workers, threads_per_worker=1, processes=True, protocol="tcp", dashboard_address=None
        )
        return str(self._cluster.scheduler_address)

    def __exit__(self, *_: object) -> None:
        if self._dask:
            self._cluster.close()


def _synthetic_raw(path: Path, rows: int) -> int:
    """Write the raw items; bytes written."""
    generator = np.random.default_rng(0)
    typical = np.exp(generator.normal(6, 1, (CATEGORIES, 3)))
    with path.open("w", encoding="utf-8") as file:
        for first in range(0, rows, BATCH):
            n = min(BATCH, rows - first)
            kind = (generator.pareto(1.0, n) * 10).astype(int) % CATEGORIES  # a few kinds have most rows, as in shops
            sizes = (typical[kind] * np.exp(generator.normal(0, 0.2, (n, 3)))).round(1) + 1.0
            form = generator.random(n)
            for row in range(n):
                number = first + row - (row % 100 == 99)  # one in a hundred repeats the id before it
                file.write(_synthetic_item(number, int(kind[row]), sizes[row].tolist(), form[row]).line())
                file.write("\n")
    return path.stat().st_size


def _synthetic_item(number: int, kind: int, sizes: list[float], form: float) -> RawItem:
    if form < 0.001:
        sizes = [size * 10 for size in sizes]
    words = {"width": sizes[0], "depth": None if form < 0.2 else sizes[1], "height": sizes[2]}
    return RawItem(
        source=f"shop{number % 8}",
        source_id=str(number),
        url=f"https://example.org/{number}",
        title=f"thing of kind {kind}, model {number}",
        category_path=("things", f"kind{kind}"),
        dimensions_mm={} if form > 0.9 else words,
        extents_mm=tuple(sorted(sizes, reverse=True)) if form > 0.9 else None,
    )


def _synthetic_categories() -> Iterator[Category]:
    paths: dict[str, tuple[str, ...]] = {"top": ("top",)}
    yield Category(node_id="top", name="top", synset=None, parent_id=None, level=1, path=("top",))
    sizes = [CATEGORIES]
    for fan in FAN[:3]:
        sizes.append(sizes[-1] // fan)
    for level, count in zip((2, 3, 4, 5), reversed(sizes), strict=True):
        for number in range(count):
            name = f"kind{number}" if level == 5 else f"level{level}-{number}"
            above = "top" if level == 2 else f"level{level - 1}-{number // FAN[5 - level]}"
            paths[name] = (*paths[above], name)
            yield Category(
                node_id=f"mt:{name}",
                name=name,
                synset=None,
                parent_id=above if above == "top" else f"mt:{above}",
                level=level,
                path=paths[name],
            )


if __name__ == "__main__":
    main()
