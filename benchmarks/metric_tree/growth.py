"""Time and memory of a build against its rows: `python -m benchmarks.metric_tree.growth [--rows 10000 100000]`.

Raw items are synthetic: four hundred categories in the shape of a tree of five levels, sizes log-normal, a fifth of the
rows without depth, a tenth without words, a per cent repeated, a per mille in the wrong unit. The taxonomy matches by
name, so that the figures are those of the build and not of WordNet. With `--dask` the build runs on a Dask scheduler
and its workers over TCP on this machine. Memory is the proportional set size (PSS) of all processes, sampled.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import options_parser
from crawler.items import RawItem, raw_lines
from metric_base.executors import executor_of
from metric_tree.pipeline.build import BuildOptions, build_release, shipped_taxonomy
from taxonomy.categories import Category, Match

#: Number of leaves of the synthetic tree.
CATEGORIES = 400

#: Children of each inner node of the synthetic tree: 400 leaves under 40, 8, 2 and the root.
FAN = (10, 5, 4, 2)

#: Rows that are written at a time.
BATCH = 10_000


class MadeTaxonomy:
    """Leaves `kind<number>` of a tree of five levels, matched by name."""

    def __init__(self) -> None:
        self._categories = list(_made_categories())
        self._ids = {category.name: category.node_id for category in self._categories if category.level == 5}

    def categories(self) -> list[Category]:
        """All nodes, parents first."""
        return self._categories

    def match(self, item: RawItem) -> Match:
        """The leaf that the item's category names."""
        return Match(self._ids.get(item.category_path[-1]), 1.0, "name")


@cache
def made_taxonomy() -> MadeTaxonomy:
    return MadeTaxonomy()


def main() -> None:
    """Print a row for each number of raw items."""
    parser = options_parser(__doc__)
    parser.add_argument("--rows", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--dask", action="store_true", help="a Dask scheduler and its workers over TCP")
    parser.add_argument(
        "--raw", type=Path, help="a file of raw items instead of synthetic ones, and the shipped taxonomy"
    )
    parser.add_argument("--folder", type=Path, help="folder of one build, which prints its own figures")
    options = parser.parse_args()
    if options.folder is not None:
        print(json.dumps(_measured(options)))
        return
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {options.workers} workers{', Dask' * options.dask}")
    columns = (
        "rows",
        "raw MB",
        "wall s",
        "cpu s",
        "PSS of all MB",
        "largest process MB",
        "rows of the fit",
        "work folder MB",
    )
    print(" | ".join([*columns, "cpu s of the parent by step"]))
    for rows in options.rows if options.raw is None else [sum(1 for _ in raw_lines(options.raw))]:
        with tempfile.TemporaryDirectory(prefix="growth-") as name:
            folder = Path(name)
            raw = _made_raw(folder / "raw.jsonl", rows) if options.raw is None else options.raw.stat().st_size
            words = ["--folder", name, "--workers", str(options.workers), *["--dask"] * options.dask]
            words += [] if options.raw is None else ["--raw", str(options.raw)]
            command = [sys.executable, "-m", "benchmarks.metric_tree.growth", *words]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
                peak = largest = work = 0
                while process.poll() is None:
                    sizes = [_pss(pid) for pid in _family(process.pid)]
                    peak, largest = max(peak, sum(sizes)), max([largest, *sizes])
                    work = max(work, sum(_size(file) for file in (folder / "release.build").glob("work/*")))
                    time.sleep(0.5)
                found = json.loads(process.stdout.read()) if process.stdout else {}
            figures = [
                f"{rows:,}",
                f"{raw / 1e6:.0f}",
                f"{found['wall']:.0f}",
                f"{found['cpu']:.0f}",
                f"{peak / 1e6:.0f}",
                f"{largest / 1e6:.0f}",
            ]
            figures += [f"{found['n_fit']:,}", f"{work / 1e6:.0f}", str(found["steps"])]
            print(" | ".join(figures), flush=True)


def _family(pid: int) -> list[int]:
    """Return a process and its descendants."""
    try:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    except OSError:
        return []
    return [pid, *(one for child in text.split() for one in _family(int(child)))]


def _pss(pid: int) -> int:
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("Pss:")), 0)


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0


def _measured(options: argparse.Namespace) -> dict[str, Any]:
    """Build the raw items of a folder in this process and its workers."""
    workers, raw = options.workers, options.raw or options.folder / "raw.jsonl"
    taxonomy = made_taxonomy if options.raw is None else shipped_taxonomy
    started, cpu, steps = time.perf_counter(), time.process_time(), dict[str, float]()

    def progress(step: str, _done: int, _total: int | None) -> None:
        nonlocal cpu
        now = time.process_time()
        steps[step] = steps.get(step, 0.0) + now - cpu
        cpu = now

    content = BuildOptions(version="0.0.0", created="2026-01-01", heldout=False)
    with ExitStack() as stack:
        address = None
        if options.dask:
            from distributed import LocalCluster

            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, protocol="tcp", dashboard_address=None
            )
            address = str(stack.enter_context(cluster).scheduler_address)
        executor = stack.enter_context(executor_of(workers, address))
        build = build_release(
            [raw],
            options.folder / "release",
            content,
            taxonomy=taxonomy,
            declared={},
            executor=executor,
            progress=progress,
        )
    progress("publish", 1, 1)
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return {
        "wall": time.perf_counter() - started,
        "cpu": own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime,
        "steps": {step: round(seconds, 2) for step, seconds in steps.items()},
        "n_fit": build.release.manifest["counts"]["n_fit"],
    }


def _made_raw(path: Path, rows: int) -> int:
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
                file.write(_made_item(number, int(kind[row]), sizes[row].tolist(), form[row]).line())
                file.write("\n")
    return path.stat().st_size


def _made_item(number: int, kind: int, sizes: list[float], form: float) -> RawItem:
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


def _made_categories() -> Iterator[Category]:
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
