"""What each level of the tree explains of size.

`python -m benchmarks.taxonomy.levels RAW... [--tree-2020 FILE] [--paths N]`.

RAW are files of raw items. Size is the log of an item's three extents, longest first; a leaf weighs as many items as it
has, but no more than `MOST`, so that no shop's range decides. The tree of 2020 (`metrictree.json`) is judged on the
items that it has a category for by name; the cuts that `benchmarks.taxonomy.propose_levels` proposes from the same
sizes stand beside
the frozen levels. `--paths` prints random paths for a reader to judge. `--propose` prints the concepts that the matcher
finds and the tree has no leaf for, with the kind that the rule would give them: what a new source proposes to a reader.
"""

from __future__ import annotations

import argparse
import json
import random
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.taxonomy.propose_levels import explained, nested_cuts
from crawler.items import raw_items
from metric_base.arrays import FloatArray
from taxonomy.catalogue import default_catalogue
from taxonomy.categories import Category
from taxonomy.matching.matcher import default_matcher
from taxonomy.matching.shipped import default_taxonomy
from taxonomy.naming.spelling import plain_fold, singular_phrases

#: Items after which a leaf weighs no more.
MOST = 50
SEED = 2020


def leaf_sizes(files: list[Path]) -> dict[str, FloatArray]:
    """(n, 3) log extents in mm of the items of each leaf, longest first."""
    taxonomy = default_taxonomy()
    found: dict[str, list[list[float]]] = defaultdict(list)
    for file in files:
        for item in raw_items(file):
            if item.kind != "curated" and item.extents_mm and len(item.extents_mm) == 3:
                leaf = taxonomy.match(item).node_id
                if leaf:
                    found[leaf].append(sorted(np.log(item.extents_mm), reverse=True))
    return {leaf: np.array(rows) for leaf, rows in found.items()}


def item_share(groups: Mapping[str, str], sizes: Mapping[str, FloatArray]) -> float:
    """Share of the variance of items' log size between groups of leaves."""
    values, weights, labels = {}, {}, {}
    for leaf in sorted(set(groups) & set(sizes)):
        for number, row in enumerate(sizes[leaf]):
            key = f"{leaf}#{number}"
            values[key], labels[key] = row, groups[leaf]
            weights[key] = min(len(sizes[leaf]), MOST) / len(sizes[leaf])
    return explained(labels, values, weights)


def ours(by_id: Mapping[str, Category], sizes: Mapping[str, FloatArray]) -> dict[str, float]:
    """Share by level of the frozen tree."""
    paths = {leaf: by_id[leaf].path for leaf in sizes}
    return {
        f"level {n}": item_share({leaf: " > ".join(p[:n]) for leaf, p in paths.items()}, sizes) for n in range(2, 6)
    }


def proposed(by_id: Mapping[str, Category], sizes: Mapping[str, FloatArray]) -> dict[str, float]:
    """Share and size of the cuts that the rule proposes for the leaves that WordNet has a path to."""
    paths = {leaf: default_catalogue().wordnet_path(leaf) for leaf in sizes}
    paths = {leaf: path for leaf, path in paths.items() if path[0] == "entity.n.01"}
    means = {leaf: rows.mean(axis=0) for leaf, rows in sizes.items()}
    familiar = {c.node_id: 1.0 for c in by_id.values() if c.level == 4}
    cuts = nested_cuts(paths, means, familiar)
    return {
        f"{len(set(groups.values()))} {name}": item_share(groups, sizes)
        for name, groups in zip(("kinds", "families", "realms"), cuts, strict=True)
    }


def tree_2020(file: Path) -> list[tuple[str, ...]]:
    """All paths of the authors' tree, root first."""
    return list(_walk(json.loads(file.read_text(encoding="utf-8")), ()))


def _walk(node: dict[str, Any], above: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    path = (*above, node["name"])
    yield path
    for child in node.get("children", ()):
        yield from _walk(child, path)


def named_2020(paths: list[tuple[str, ...]], by_id: Mapping[str, Category]) -> dict[str, tuple[str, ...]]:
    """Path in the tree of 2020 of those of our leaves that it has a category for, by any of their names."""
    index: dict[str, tuple[str, ...]] = {}
    for path in paths:
        index.setdefault(_key(path[-1]), path)
    found = {}
    for category in by_id.values():
        if category.level == 5:
            names = (category.name.removesuffix(" (unspecified)"), *category.aliases)
            path = next((index[_key(name)] for name in names if _key(name) in index), None)
            if path:
                found[category.node_id] = path
    return found


def _key(name: str) -> str:
    form = plain_fold(name)
    return next(singular_phrases(form), form).replace(" ", "")


def propose(files: list[Path]) -> None:
    """Concepts without a leaf, where the rule would put them, and their items."""
    matcher, catalogue = default_matcher(), default_catalogue()
    counts: Counter[str] = Counter()
    for item in (item for file in files for item in raw_items(file) if item.kind != "curated"):
        found = matcher.finding(item.source, item.category_path, item.title, item.synset)
        if found.concept and found.settled and catalogue.leaf_of(found.concept) is None:
            counts[found.concept] += item.count
    placed = catalogue.with_placed(counts, matcher.lexicon)
    for concept, count in counts.most_common():
        leaf = placed.leaves.get(concept)
        print(f"{count:6d} {concept} -> {leaf.parent_id if leaf else 'no kind claims it'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("raw", nargs="+", type=Path)
    parser.add_argument("--tree-2020", type=Path)
    parser.add_argument("--paths", type=int, default=0)
    parser.add_argument("--seed", type=int, default=SEED, help="of the paths drawn (default: %(default)s)")
    parser.add_argument("--propose", action="store_true")
    arguments = parser.parse_args()
    if arguments.propose:
        propose(arguments.raw)
        return
    by_id = {category.node_id: category for category in default_catalogue().categories}
    sizes = leaf_sizes(arguments.raw)
    print(f"{sum(map(len, sizes.values()))} items with three extents on {len(sizes)} leaves")
    _table("frozen levels", ours(by_id, sizes))
    _table("cuts proposed by the rule", proposed(by_id, sizes))
    if arguments.tree_2020:
        paths = tree_2020(arguments.tree_2020)
        named = {leaf: path for leaf, path in named_2020(paths, by_id).items() if leaf in sizes}
        both = {leaf: sizes[leaf] for leaf in named}
        print(f"\n{len(both)} leaves that both trees have")
        _table("frozen levels", ours(by_id, both))
        shares = {n: item_share({leaf: " > ".join(p[:n]) for leaf, p in named.items()}, both) for n in range(2, 6)}
        _table("tree of 2020", {f"depth {n}": share for n, share in shares.items()})
        _samples(
            "ours",
            [c.path for c in by_id.values() if c.level == 5 and c.node_id in sizes],
            arguments.paths,
            arguments.seed,
        )
        _samples(
            "2020",
            [p for p in paths if not any(q[: len(p)] == p and q != p for q in paths)],
            arguments.paths,
            arguments.seed,
        )


def _table(title: str, shares: Mapping[str, float]) -> None:
    print(f"{title}: " + ", ".join(f"{name} {share:.3f}" for name, share in shares.items()))


def _samples(title: str, paths: list[tuple[str, ...]], number: int, seed: int) -> None:
    if number:
        print(f"\n# {title}")
        drawn = random.Random(seed).sample(sorted(paths), min(number, len(paths)))  # noqa: S311 - a sample
        for path in drawn:
            print(" > ".join(path))


if __name__ == "__main__":
    main()
