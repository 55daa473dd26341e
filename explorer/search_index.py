"""The index of names that the browser searches: made by the tree's resolver, so that both mean the same by a name.

It is a script, not JSON, since a page from `file://` may load scripts and nothing else. Its lines are compact: the
page's script unfolds them (`assets/search.js`).
"""

from __future__ import annotations

import json

from explorer.catalogue import MEANINGS, ReleaseCatalogue
from explorer.urls import slug
from metric_tree.node import Node
from taxonomy.words.spelling import plain_fold


def name_index(catalogue: ReleaseCatalogue) -> bytes:
    """Nodes with their names and labels, names of several nodes, label lists, sources.

    `nodes` has a line for each node: slug, name where the slug does not spell it, tier, items, its parent's place.
    `aliases` has the further names that it alone has; `shared` the names of several nodes, the likeliest first;
    `labels` the labels of lists, empty where one is the node's name, with letters for its lists.
    """
    nodes = sorted(catalogue.nodes.values(), key=lambda node: node.node_id)
    places = {node.node_id: place for place, node in enumerate(nodes)}
    tiers, lists = list(MEANINGS), list(catalogue.vocabularies)
    alone: dict[str, list[str]] = {}
    shared = []
    for name, owners in catalogue.tree.names():
        if len(owners) > 1:
            shared.append(f"{name}\t{','.join(str(places[node_id]) for node_id in owners)}")
        elif name != plain_fold(catalogue.nodes[owners[0]].name):
            alone.setdefault(owners[0], []).append(name)
    content = {
        "tiers": tiers,
        "nodes": "\n".join(_line(catalogue, node, tiers, places) for node in nodes),
        "aliases": "\n".join(",".join(alone.get(node.node_id, ())) for node in nodes),
        "shared": "\n".join(sorted(shared)),
        "lists": lists,
        "labels": "\n".join(_labels(catalogue, node.node_id, lists) for node in nodes),
        "sources": [[source["id"], source["title"]] for source in catalogue.sources.values()],
    }
    return f"var MT_NAMES={json.dumps(content, separators=(',', ':'), ensure_ascii=False)};\n".encode()


def size_index(catalogue: ReleaseCatalogue) -> bytes:
    """For pages that compare nodes: dimensions and quantiles in mm of all nodes, by slug, to three digits."""
    rows = {
        slug(node.node_id): [
            node.name,
            catalogue.tier(node),
            node.n_items,
            {
                dim: [float(f"{value:.3g}") for value in column]
                for dim, column in zip(catalogue.dims(node), catalogue.quantiles(node).T, strict=True)
            },
        ]
        for node in catalogue.nodes.values()
    }
    return f"var MT_SIZES={json.dumps(rows, separators=(',', ':'), ensure_ascii=False)};\n".encode()


def _line(catalogue: ReleaseCatalogue, node: Node, tiers: list[str], places: dict[str, int]) -> str:
    own = node.node_id.removeprefix("mt:").partition(".")[0].replace("_", " ")
    name = "" if node.name == own else node.name
    above = places[node.parent_id] if node.parent_id else ""
    return f"{slug(node.node_id)}\t{name}\t{tiers.index(catalogue.tier(node))}\t{node.n_items or ''}\t{above}"


def _labels(catalogue: ReleaseCatalogue, node_id: str, lists: list[str]) -> str:
    """The labels of a node, each with a letter for each of its lists."""
    found: dict[str, str] = {}
    own = plain_fold(catalogue.nodes[node_id].name)
    for name, label in catalogue.labels.get(node_id, ()):
        form = plain_fold(label)
        letter = chr(ord("a") + lists.index(name))
        shown = "" if form == own else form
        if letter not in found.get(shown, ""):
            found[shown] = found.get(shown, "") + letter
    return ",".join(f"{label}@{letters}" for label, letters in found.items())
