"""Index of names for the search in the browser, from the resolver of the tree, so that both resolve names equally.

It is a script, not JSON, because a page from `file://` may load only scripts. `assets/search.js` expands its compact
lines.
"""

from __future__ import annotations

import json

from explorer.catalogue import MEANINGS, ReleaseCatalogue
from explorer.urls import slug
from taxonomy.words.spelling import plain_fold


def name_index(catalogue: ReleaseCatalogue) -> bytes:
    """Return the script with nodes, their names and labels, label lists and sources.

    `nodes` has a line per node: slug, name unless the slug spells it, tier, number of items, index of the parent.
    `aliases` has the other names of each node that no other node has; `shared` the names of several nodes, the most
    likely node first; `labels` the labels of the node (empty if equal to its name), each with letters of its lists.
    """
    nodes = sorted(catalogue.nodes.values(), key=lambda node: node.node_id)
    indices = {node.node_id: index for index, node in enumerate(nodes)}
    tiers, lists = list(MEANINGS), list(catalogue.vocabularies)
    alone: dict[str, list[str]] = {}
    shared = []
    for name, owners in catalogue.tree.names():
        if len(owners) > 1:
            shared.append(f"{name}\t{','.join(str(indices[node_id]) for node_id in owners)}")
        elif name != plain_fold(catalogue.nodes[owners[0]].name):
            alone.setdefault(owners[0], []).append(name)
    lines, labels = [], []
    for node in nodes:
        spelt = node.node_id.removeprefix("mt:").partition(".")[0].replace("_", " ")
        name = "" if node.name == spelt else node.name
        parent = indices[node.parent_id] if node.parent_id else ""
        tier = tiers.index(catalogue.tier(node))
        lines.append(f"{slug(node.node_id)}\t{name}\t{tier}\t{node.n_items or ''}\t{parent}")
        letters: dict[str, str] = {}  # of the lists, by label
        for list_name, label in catalogue.labels.get(node.node_id, ()):
            shown = "" if plain_fold(label) == plain_fold(node.name) else plain_fold(label)
            letter = chr(ord("a") + lists.index(list_name))
            if letter not in letters.get(shown, ""):
                letters[shown] = letters.get(shown, "") + letter
        labels.append(",".join(f"{label}@{of_label}" for label, of_label in letters.items()))
    content = {
        "tiers": tiers,
        "nodes": "\n".join(lines),
        "aliases": "\n".join(",".join(alone.get(node.node_id, ())) for node in nodes),
        "shared": "\n".join(sorted(shared)),
        "lists": lists,
        "labels": "\n".join(labels),
        "sources": [[source["id"], source["title"]] for source in catalogue.sources.values()],
    }
    return f"var MT_NAMES={json.dumps(content, separators=(',', ':'), ensure_ascii=False)};\n".encode()


def size_index(catalogue: ReleaseCatalogue) -> bytes:
    """Return the script for comparisons: name, tier, items and quantiles in mm (three digits) of all nodes by slug."""
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
