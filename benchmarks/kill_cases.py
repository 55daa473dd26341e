"""The commands that `benchmarks.kills` kills: their small inputs, their words, and what is right in their results."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.child import ours
from tests.synthetic.shop import PictureShop
from tests.synthetic.synthetic_site import Shop, SyntheticSite

__all__ = ["CASES", "Case", "Prepared"]

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "data"
CONTACT = ["--contact", "tests@example.org", "--delay", "0", "--private"]
DECLARATION = """
id = "boxes"
title = "Synthetic boxes"
url = "https://example.org/boxes"
licence = "none"
licence_basis = "written for a benchmark"
kind = "measured"
ship = false
[[tables]]
files = ["*.csv"]
unit = "cm"
id = "{no}"
category = ["box"]
axes = { width = "w" }
"""
FILE = """
[[files]]
path = "{name}"
sha256 = "{sha256}"
url = "{url}"
"""


@dataclass(frozen=True, slots=True)
class Prepared:
    """Inputs of a command: a folder, and an address where something is served."""

    folder: Path
    base: str
    stack: ExitStack

    def close(self) -> None:
        """Stop what serves them."""
        self.stack.close()


@dataclass(frozen=True, slots=True)
class Case:
    """A command that is killed.

    Parameters
    ----------
    prepare : makes the inputs in a folder.
    command : the words of a run in a folder, and of one that goes on after a kill.
    outcome : the parts of the result by name, with their bytes or values, each counted.
    results : what a whole run leaves in its folder.
    stands : what a run says that finds the whole result there, made before the kill.
    """

    name: str
    prepare: Callable[[Path], Prepared]
    command: Callable[[Prepared, Path, bool], list[str]]
    outcome: Callable[[Path], Counter[str]]
    results: tuple[str, ...]
    stands: str = "already exists"


_metric_tree = partial(ours, "metric-tree")


def _files(place: Path, *names: str) -> Counter[str]:
    """Each file below the named folders, with the sha256 of its bytes."""
    return Counter(
        f"{path.relative_to(place)} {hashlib.sha256(path.read_bytes()).hexdigest()}"
        for name in names
        for path in sorted((place / name).rglob("*"))
        if path.is_file()
    )


def _shop(folder: Path) -> Prepared:
    folder.mkdir()
    stack = ExitStack()
    site = stack.enter_context(SyntheticSite(Shop(products=80, errors=False, delay=0.1)))
    return Prepared(folder, site.base, stack)


def _crawl(prepared: Prepared, place: Path, again: bool) -> list[str]:
    known = again and any((place / "crawl").glob("frontier.sqlite"))
    start = ["--resume"] if known else ["--start-url", f"{prepared.base}/list/0"]
    return _metric_tree("crawl", "generic", "--out", place / "crawl", "--pictures", *CONTACT, *start)


def _crawled(place: Path) -> Counter[str]:
    def records(kind: str) -> list[dict[str, Any]]:
        files = sorted((place / "crawl").rglob(f"{kind}-*.jsonl"))
        return [json.loads(line) for path in files for line in path.read_text().splitlines()]

    items = [f"item {item['title']} {item['extents_mm']}" for item in records("items")]
    pictures = [f"picture {record['item_id']} {record['path']}" for record in records("pictures")]
    files = [f"file {path.name}" for path in (place / "crawl" / "pictures").rglob("*") if path.is_file()]
    return Counter(items + pictures + files)


def _raw(folder: Path) -> Prepared:
    folder.mkdir()
    for name in ("gazebo_models", "open_models"):
        (folder / f"{name}.jsonl.gz").symlink_to(DATA / "raw" / f"{name}.jsonl.gz")
    return Prepared(folder, "", ExitStack())


def _build(prepared: Prepared, place: Path, _again: bool) -> list[str]:
    options = ["--created", "2026-01-01", "--workers", "2", "--no-heldout", "--without-curated"]
    return _metric_tree("build", prepared.folder, "--out", place / "release", *options)


def _pictures(folder: Path) -> Prepared:
    """A release with the pictures of a crawl."""
    folder.mkdir()
    with PictureShop() as shop:
        crawl = ["crawl", "generic", "--out", folder / "crawl", "--start-url", f"{shop.base}/list", "--pictures"]
        subprocess.run(_metric_tree(*crawl, *CONTACT), check=True, capture_output=True)
    build = ["build", folder / "crawl", "--out", folder / "release", "--include-withheld", "127.0.0.1", "--no-heldout"]
    subprocess.run(_metric_tree(*build, "--workers", 1), check=True, capture_output=True)
    return Prepared(folder, "", ExitStack())


def _cutout(prepared: Prepared, place: Path, _again: bool) -> list[str]:
    return _metric_tree("cutout", prepared.folder / "release", "--out", place / "cut", "--backend", "plain")


def _cut_pictures(folder: Path) -> Prepared:
    prepared = _pictures(folder)
    subprocess.run(_cutout(prepared, folder, False), check=True, capture_output=True)
    return prepared


def _export(prepared: Prepared, place: Path, _again: bool) -> list[str]:
    categories = "dining chair,dining table,computer mouse"
    options = ["--pictures", 40, "--categories", categories, "--jobs", 2]
    return _metric_tree("export", "--tree", prepared.folder / "cut", "--out", place / "set", *options)


def _video(folder: Path) -> Prepared:
    folder.mkdir()
    return Prepared(folder, "", ExitStack())


def _estimate(_prepared: Prepared, place: Path, _again: bool) -> list[str]:
    video = DATA / "scenes" / "demo_video"
    words = [video / "video.mp4", "--instances", video / "instances.json", "--frames", 12, "--dense", "none"]
    words += ["--work", place / "work", "--output", place / "scale.json"]
    return ours("estimate-scale", *words)


def _estimated(place: Path) -> Counter[str]:
    """The scale to a thousandth, and the names of what the work folder holds."""
    result = json.loads((place / "scale.json").read_text())
    names = Counter(str(path.relative_to(place)) for path in (place / "work").rglob("*") if path.is_file())
    return names + Counter([f"scale {result['scale']:.3g}"])


def _served_tables(folder: Path) -> Prepared:
    """A source of twelve tables that a server of this machine gives slowly."""
    from tests.synthetic.slow_files import SlowFiles

    folder.mkdir()
    tables = {
        f"boxes-{row:02d}.csv": b"no,w\n" + b"".join(b"%d-%d,%d\n" % (row, k, 10 + k % 90) for k in range(300))
        for row in range(12)
    }
    stack = ExitStack()
    site = stack.enter_context(SlowFiles(tables, seconds=0.1))
    files = [
        FILE.format(name=name, sha256=hashlib.sha256(data).hexdigest(), url=f"{site.base}/{name}")
        for name, data in tables.items()
    ]
    (folder / "boxes.toml").write_text(DECLARATION + "".join(files))
    return Prepared(folder, site.base, stack)


def _import(prepared: Prepared, place: Path, _again: bool) -> list[str]:
    words = ["import", "boxes", "--sources", prepared.folder, "--out", place / "raw" / "boxes.jsonl"]
    return ["env", f"METRIC_TREE_CACHE={place / 'cache'}", *_metric_tree(*words)]


CASES = {
    case.name: case
    for case in (
        Case("crawl", _shop, _crawl, _crawled, ("crawl",)),
        Case(
            "build", _raw, _build, lambda place: _files(place, "release", "release.build"), ("release", "release.build")
        ),
        Case("cutout", _pictures, _cutout, lambda place: _files(place, "cut"), ("cut",)),
        Case("export", _cut_pictures, _export, lambda place: _files(place, "set"), ("set",)),
        Case("estimate-scale", _video, _estimate, _estimated, ("work", "scale.json")),
        Case("import", _served_tables, _import, lambda place: _files(place, "raw", "cache"), ("raw", "cache")),
    )
}
