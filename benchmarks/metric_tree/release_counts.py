"""The counts of a release: `python -m benchmarks.metric_tree.release_counts RAW... --release DIR`.

Leaves by evidence, the paper's funnel, sources, refused rows by reason, items with year and region, ten random leaves.
The first two steps of the build are run again on the raw items, so that every item is counted by its kind after repeats
and slips are out, also those whose rows the release may not ship.
"""

from __future__ import annotations

import argparse
import json
import random
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow as pa

from crawler.imports.source_files import quarantine_path
from crawler.imports.sources import Source, sources
from crawler.items import RawItem
from metric_base.progress import silent
from metric_cli.terminal import print_table
from metric_cli.verbs.build import executor_of
from metric_tree.build.clean import NodeClass
from metric_tree.build.ingest import block_of, blocks, raw_files
from metric_tree.build.steps import Options, Steps, shipped_curated, shipped_taxonomy
from metric_tree.build.tables import evidence_counts
from metric_tree.build.work_folder import BuildFolder, SerialExecutor
from metric_tree.tree import Tree, open_tree
from taxonomy.categories import Taxonomy

__all__ = ["Counted", "Dated", "counted", "dated", "funnel", "main", "random_paths", "refused"]

#: Seed of the sample of leaves; any other does as well.
SEED = 20261121

#: Leaves whose paths are shown.
SHOWN = 10

Path_ = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Counted:
    """The classes of a build, its rows refused by reason, and the leaf of every row that it took, by item id."""

    classes: Sequence[NodeClass]
    reasons: Mapping[str, int]
    leaves: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Dated:
    """Of one source: raw items, and those of them with a year and with a region."""

    source: str
    items: int
    year: int
    region: int


def main() -> None:
    """Print every table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("raw", nargs="+", type=Path, metavar="RAW", help="raw items of the release, as the build took")
    parser.add_argument("--release", type=Path, default=Path("data/release/2.0.0"), help="(default: %(default)s)")
    parser.add_argument("--workers", type=int, default=1, help="processes (default: %(default)s)")
    arguments = parser.parse_args()
    tree = open_tree(arguments.release)
    found = counted(arguments.raw, tree.release.manifest, arguments.workers)
    _print_evidence(tree, found)
    paths = dict(_item_paths(arguments.raw))
    print_table(("step of the funnel", "n"), funnel(found, paths, tree))
    print_table(("sources", "n"), _source_counts(tree))
    for title, reasons in (("refused at import", refused(arguments.raw)), ("refused by the build", found.reasons)):
        print_table((title, "rows"), [*Counter(reasons).most_common(), ("all", sum(reasons.values()))])
    rows = dated(arguments.raw)
    whole = Dated("all", *(sum(getattr(row, name) for row in rows) for name in ("items", "year", "region")))
    print_table(("source", "items", "with year", "with region"), [_shares(row) for row in [*rows, whole]])
    print_table((f"{SHOWN} random leaves (seed {SEED})", "items"), random_paths(tree))


def counted(
    raw: Sequence[Path],
    manifest: Mapping[str, Any],
    workers: int = 1,
    *,
    taxonomy: Callable[[], Taxonomy] = shipped_taxonomy,
    curated: Iterable[RawItem] | None = None,
) -> Counted:
    """Steps 1 and 2 of the build that gave this manifest, on the same raw items."""
    fold = manifest.get("fold_out")
    options = Options(
        version=manifest["version"],
        created=manifest["created"],
        noncommercial=manifest.get("noncommercial", True),
        private=tuple(manifest.get("private", ())),
        fold_out=None if fold is None else (fold[0], fold[1]),
    )
    declared: dict[str, Source] = {source.id: source for source in sources()}
    with (
        tempfile.TemporaryDirectory() as folder,
        BuildFolder.open(Path(folder) / "work", "counts") as work,
        executor_of(workers, None) as executor,
    ):
        steps = Steps(options, taxonomy, declared, None, executor or SerialExecutor(), silent, work)
        own = block_of(shipped_curated() if curated is None else curated, "curated ranges")
        counts = steps.ingest(chain(blocks(raw_files(raw)), [own]))
        classes, dropped = steps.clean()
        leaves = dict(_leaves(work.directory))
    reasons = {reason: n for reason, n in (counts + dropped).items() if reason != "taken"}
    return Counted(classes, reasons, leaves)


def funnel(found: Counted, paths: Mapping[str, Path_], tree: Tree) -> list[tuple[str, int]]:
    """From the categories that sources name to the leaves of the tree (the paper's figure of its data)."""
    sized = {(item_id.partition(":")[0], path) for item_id, path in paths.items()}
    taken = {(item_id.partition(":")[0], paths[item_id]) for item_id in found.leaves if item_id in paths}
    leaves = [node for node in tree if not node.children]
    return [
        ("raw categories with sizes, a source and a path each", len(sized)),
        ("as texts, over all sources", len({tuple(word.casefold() for word in path) for _, path in sized})),
        ("matched to a leaf", len(taken)),
        ("merged concepts: leaves they reach", len({found.leaves[item_id] for item_id in found.leaves.keys() & paths})),
        ("leaves with items after repeats and slips", sum(node.n_items > 0 for node in leaves)),
        ("leaves in all, with norms and ranges", len(leaves)),
    ]


def refused(raw: Sequence[Path]) -> dict[str, int]:
    """Rows refused at import by reason, from the quarantine files beside the raw items."""
    reasons: Counter[str] = Counter()
    for path in raw_files(raw):
        if (beside := quarantine_path(path)).is_file():
            reasons.update(json.loads(line)["reason"] for block in blocks([beside]) for line in block.lines)
    return dict(reasons)


def dated(raw: Sequence[Path]) -> list[Dated]:
    """Raw items with year and region by source, those of most items with a year first."""
    found: dict[str, Counter[str]] = {}
    for item in _items(raw):
        found.setdefault(item.source, Counter()).update(
            {"items": 1, "year": item.year is not None, "region": item.region is not None}
        )
    rows = [Dated(name, *(int(counts[c]) for c in ("items", "year", "region"))) for name, counts in found.items()]
    return sorted(rows, key=lambda row: (-row.year, -row.region, row.source))


def random_paths(tree: Tree, n: int = SHOWN, seed: int = SEED) -> list[tuple[str, int]]:
    """Paths and items of random leaves that have items."""
    leaves = sorted((node for node in tree if not node.children and node.n_items), key=lambda node: node.node_id)
    chosen = random.Random(seed).sample(leaves, min(n, len(leaves)))  # noqa: S311 - a sample, no secret
    return [(" > ".join(node.path), node.n_items) for node in chosen]


def _print_evidence(tree: Tree, found: Counted) -> None:
    counts = evidence_counts(found.classes)
    columns = ("items", "leaves_1", "leaves_10", "leaves_30")
    print_table(("evidence", *columns), [(name, *(own[c] for c in columns)) for name, own in counts.items()])
    recorded = tree.release.manifest["counts"]
    stated = (recorded["n_fit"], *(recorded[name] for name in columns[1:]))
    again = tuple(counts["any"][name] for name in columns)
    same = "the same" if stated == again else f"NOT THE SAME: {stated} there; raw items or taxonomy have changed since"
    print(f"the manifest's own counts of any evidence: {same}\n")


def _source_counts(tree: Tree) -> list[tuple[str, int]]:
    records = [
        record for record in tree.release.manifest["sources"] if record["kind"] not in {"curated", "judged", "norm"}
    ]
    kinds = Counter(record["kind"] for record in records).most_common()
    shipped = ("whose rows ship", sum(not record["withheld"] for record in records))
    return [("all, norms and ranges left out", len(records)), *((f"kind {kind}", n) for kind, n in kinds), shipped]


def _items(raw: Sequence[Path]) -> Iterator[RawItem]:
    for block in blocks(raw_files(raw)):
        yield from (RawItem.from_line(line) for line in block.lines if line.strip())


def _item_paths(raw: Sequence[Path]) -> Iterator[tuple[str, Path_]]:
    for item in _items(raw):
        yield f"{item.source}:{item.source_id}", item.category_path


def _leaves(work: Path) -> Iterator[tuple[str, str]]:
    for path in sorted(work.glob("ingest-*.arrow")):
        table = pa.ipc.open_file(pa.memory_map(str(path))).read_all().select(["item_id", "node_id"])
        yield from zip(table["item_id"].to_pylist(), table["node_id"].to_pylist(), strict=True)


def _shares(row: Dated) -> Iterable[object]:
    return (row.source, row.items, *(f"{n} ({n / row.items:.0%})" for n in (row.year, row.region)))


if __name__ == "__main__":
    main()
