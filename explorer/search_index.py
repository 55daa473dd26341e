"""Index of names for the search in the browser, from the resolver of the tree, so that both resolve names equally.

It is a script, not JSON, because a page from `file://` may load only scripts. `assets/search.js` expands its compact
lines.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from explorer.catalogue import MEANINGS, ReleaseCatalogue
from explorer.charts.size_comparison import REFERENCES
from explorer.everyday_sizes import shape_letter
from explorer.fit import OPENINGS, mixture_table
from explorer.queries import LEADING, PUNCTUATION, TRAILING
from explorer.responses import medians
from explorer.urls import slug
from metric_base.length_units import MILLIMETRES, UNIT_WORDS
from metric_tree.node import Node, UnknownName
from metric_tree.reports.description import is_heterogeneous
from metric_tree.variants import LITRES, QUANTITY, SEATS, SHOE_SIZE, stated_size_rules, unit_symbol, variant_form
from taxonomy.naming.resolver import MIN_HEAD_COMPOUNDS, MIN_HEAD_FRACTION
from taxonomy.words.phrases import MODIFYING, word_list
from taxonomy.words.senses import head_trust, names_in_languages
from taxonomy.words.spelling import IRREGULAR, SPELLINGS, plain_fold


def name_index(catalogue: ReleaseCatalogue) -> bytes:
    """Return the script with nodes, their names and labels, label lists and sources.

    `nodes` has a line per node: slug, name unless the slug spells it, tier, number of items, index of the parent, and
    median sizes in mm after the first letters of the dimensions (1 to 3 of extents), `shape_letter`,
    and `x` if it is heterogeneous.
    `aliases` has the other names of each node that no other node has; `shared` the names of several nodes, the most
    likely node first; `labels` the labels of the node (empty if equal to its name), each with letters of its lists.
    The rest is of `word_index` and `stated_size_index`.
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
        prior = catalogue.prior(node)
        marks = shape_letter(node) + "x" * (prior is not None and is_heterogeneous(node, prior))
        fields = (slug(node.node_id), name, tier, node.n_items or "", parent, sizes_text(catalogue, node), marks)
        lines.append("\t".join(map(str, fields)))
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
        **word_index(catalogue, indices),
        "stated": stated_size_index(catalogue, indices),
        "leading": LEADING,
        "trailing": TRAILING,
        "punctuation": PUNCTUATION,
        "spellings": SPELLINGS,
        "irregular": IRREGULAR,
        "sources": [[source["id"], source["title"]] for source in catalogue.sources.values()],
    }
    return _script({"MT_NAMES": content})


def word_index(catalogue: ReleaseCatalogue, indices: Mapping[str, int]) -> dict[str, Any]:
    """Return the tables for phrases and other languages.

    `heads` has nouns whose known compounds are mostly such objects; `others` the node of each name in another
    language; `modifiers`, `copies` and `containers` are lists of words.
    """
    heads = []
    for name, owners in catalogue.tree.names():
        kinds, compounds = head_trust(name).get(owners[0], (0, 0))
        if compounds >= MIN_HEAD_COMPOUNDS and kinds / compounds >= MIN_HEAD_FRACTION:
            heads.append(name)
    others = {}
    for name, node_ids in names_in_languages().items():
        if not indices.keys().isdisjoint(node_ids):
            with suppress(UnknownName):
                meaning = catalogue.tree.resolve(name, advice=False)
                if meaning.how == "other name":
                    others[name] = indices[meaning.node.node_id]
    words = {name: sorted(word_list(name)) for name in ("copies", "containers")}
    words["modifiers"] = sorted(frozenset().union(*map(word_list, MODIFYING)))
    return {"heads": heads, "others": others, **words}


def sizes_text(catalogue: ReleaseCatalogue, node: Node) -> str:
    """Return the medians of a node in mm after the first letters of the dimensions, such as `l910,h2040.5`."""
    return ",".join(f"{dim.removeprefix('extent')[0]}{mm:.5g}" for dim, mm in medians(catalogue, node).items())


def stated_size_index(catalogue: ReleaseCatalogue, indices: Mapping[str, int]) -> dict[str, Any]:
    """Return the tables for sizes that a name states (`metric_tree.variants`).

    `variants` has a line per variant: index of the node, name, medians as in `sizes_text`, and normalised aliases.
    `rules` has node, quantity, factors by axis, exponent, range and standard deviation. `priors` has, for each node
    below a rule, its dimensions and a list of weight, means (d) and covariances (d * d) of ln mm for each component.
    `units` has the symbol, quantity and factor of each word of a unit.
    """
    variants, priors = [], {}
    rules = {rule.node_id: rule for rule in stated_size_rules() if rule.node_id in indices}
    for node in catalogue.nodes.values():
        for row in node.variants:
            forms = sorted({variant_form(alias) for alias in row.aliases.split("; ") if alias})
            if forms:
                sizes = sizes_text(catalogue, replace(node, stated=row.stated))
                variants.append(f"{indices[node.node_id]}\t{row.name}\t{sizes}\t{','.join(forms)}")
        prior = catalogue.prior(node)
        if prior is not None and any(one.node_id in rules for one in (node, *node.ancestors())):
            covariances = prior.covariances + prior.shared_covariance
            columns = zip(prior.weights, prior.means, covariances, strict=True)
            components = [np.concatenate([[weight], mean, covariance.ravel()]) for weight, mean, covariance in columns]
            dims = "".join(dim.removeprefix("extent")[0] for dim in prior.dims)
            numbers = [[float(f"{value:.7g}") for value in component] for component in components]
            priors[indices[node.node_id]] = [dims, *numbers]
    units: dict[str, tuple[str, str, float]] = {
        word: (unit_symbol(word), "length", MILLIMETRES[symbol]) for word, symbol in UNIT_WORDS.items()
    }
    units |= {word: (unit_symbol(word), "volume", litres) for word, litres in LITRES.items()}
    return {
        "variants": "\n".join(variants),
        "rules": [
            [
                indices[rule.node_id],
                rule.quantity,
                {part.split()[0][0]: float(part.split()[1]) for part in rule.axes.split("; ")},
                rule.exponent,
                rule.low,
                rule.high,
                rule.sd_log,
            ]
            for rule in rules.values()
        ],
        "priors": priors,
        "units": units,
        "patterns": {"seats": SEATS.pattern, "shoe size": SHOE_SIZE.pattern, "length": QUANTITY.pattern},
    }


def size_index(catalogue: ReleaseCatalogue) -> bytes:
    """Return the script for comparisons: sizes of all nodes by slug, and references of familiar size.

    `MT_SIZES` has for each node its name, tier, number of items, `INTERVAL_QUANTILES` in mm (three digits) by
    dimension, `shape_letter`, `mixture_table`, and the path of a cut-out image if there is one. `MT_REFERENCES` has
    name, width and height in mm, and an outline in a box of 100 by 100. `MT_OPENINGS` has the slugs of the nodes that
    are openings.
    """
    rows, openings = {}, []
    for node in catalogue.nodes.values():
        dims, prior = catalogue.dims(node), catalogue.prior(node)
        sizes = {
            dim: [float(f"{value:.3g}") for value in column]
            for dim, column in zip(dims, catalogue.quantiles(node)[::2].T, strict=True)
        }
        row: list[Any] = [node.name, catalogue.tier(node), node.n_items, sizes, shape_letter(node)]
        row.append([] if prior is None else mixture_table(prior))
        if images := [image for image in catalogue.images(node) if image["cutout_path"]]:
            # the image whose aspect ratio is closest to that of the box from the front
            across, up = (sizes.get(dim, next(iter(sizes.values()), [0, 1.0, 0]))[1] for dim in ("length", "height"))
            aspects = [abs(math.log(image["width_px"] / image["height_px"] * up / across)) for image in images]
            row.append(images[int(np.argmin(aspects))]["cutout_path"])
        rows[slug(node.node_id)] = row
        if any(one.node_id in OPENINGS for one in (node, *node.ancestors())):
            openings.append(slug(node.node_id))
    return _script({"MT_SIZES": rows, "MT_REFERENCES": REFERENCES, "MT_OPENINGS": openings})


def _script(values: Mapping[str, Any]) -> bytes:
    """Return a script that sets variables."""
    texts = {name: json.dumps(value, separators=(",", ":"), ensure_ascii=False) for name, value in values.items()}
    return "".join(f"var {name}={text};\n" for name, text in texts.items()).encode()
