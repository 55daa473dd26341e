"""What a client may ask beyond the files: search, a prior in a context, a comparison; for HTTP and for tools alike.

The JSON answers about a release: pure functions from a catalogue to records.
"""

from __future__ import annotations

import re
from base64 import urlsafe_b64decode, urlsafe_b64encode
from collections import Counter
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from explorer.catalogue import ReleaseCatalogue
from explorer.schemas import (
    ImagesAnswer,
    ItemsAnswer,
    NodeAnswer,
    NodeRef,
    PriorAnswer,
    Quantiles,
    ReleaseRef,
    ReleasesAnswer,
    SearchAnswer,
    SearchHit,
    TreeRef,
    VocabularyAnswer,
    VocabularyRow,
)
from explorer.urls import (
    LEAST_PARQUET,
    LISTED_LEVEL,
    PAGE_ROWS,
    csv_of,
    images_of,
    items_of,
    json_of,
    page_of,
    parquet_of,
    prior_of,
    slug,
)
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_tree.node import Node
from metric_tree.prior import FAMILY, MEDIAN, QUANTILES, Prior
from metric_tree.reports.description import node_sentence
from metric_tree.tree import LONGEST_NAME, Tree

#: Images of one answer: more than a page shows.
MOST_IMAGES = 12
#: Most hits of a search, quantiles and sizes of one question, nodes of a comparison: each some milliseconds at most.
MOST_HITS, MOST_QUANTILES, MOST_SIZES, MOST_COMPARED = 50, 50, 100, 6
#: Characters of a list of numbers.
LONGEST_LIST = 4000


def tree_reference(tree: Tree) -> TreeRef:
    """The release's name and version."""
    return TreeRef(tree.name, tree.version)


def shown_name(node: Node) -> str:
    """A node's name without what distinguishes it in brackets."""
    return node.name.partition(" (")[0]


def reference(catalogue: ReleaseCatalogue, node: Node) -> NodeRef:
    """A node as it is in lists."""
    medians = catalogue.quantiles(node)[MEDIAN]
    sizes = {dim: _rounded(value) for dim, value in zip(catalogue.dims(node), medians, strict=True)}
    return NodeRef(node.node_id, node.name, node.level, catalogue.tier(node), node.n_items, sizes)


def quantile_table(dims: tuple[str, ...], table: FloatArray, quantiles: tuple[float, ...] = QUANTILES) -> Quantiles:
    """Quantiles (q, d) in mm by dimension and quantile."""
    return {
        dim: {f"{q:g}": _rounded(value) for q, value in zip(quantiles, column, strict=True)}
        for dim, column in zip(dims, table.T, strict=True)
    }


def sentence(catalogue: ReleaseCatalogue, node: Node) -> str:
    """A node's main size in words."""
    prior = catalogue.prior(node)
    height = f" Height: {node.height_is}." if node.height_is else ""
    return node_sentence(node, shown_name(node), prior) + height if prior else "Nothing is known of its size."


def node_answer(catalogue: ReleaseCatalogue, node: Node) -> NodeAnswer:
    """What is known of a category."""
    prior = catalogue.prior(node)
    rows = catalogue.rows(node)
    shipped = catalogue.items.select(["kind", "licence", "source", "region"]).take(rows)
    counts = {name: _counts(shipped[name].to_pylist()) for name in shipped.column_names}
    labels: dict[str, list[str]] = {}
    for name, label in catalogue.labels.get(node.node_id, ()):
        labels.setdefault(name, []).append(label)
    return NodeAnswer(
        tree=tree_reference(catalogue.tree),
        node=node.node_id,
        name=node.name,
        synset=node.synset,
        level=node.level,
        path=list(node.path),
        path_ids=[one.node_id for one in _line(node)],
        aliases=list(node.aliases),
        labels=labels,
        pose=node.pose,
        tier=catalogue.tier(node),
        sentence=sentence(catalogue, node),
        n_items=node.n_items,
        n_shipped=len(rows),
        n_images=len(catalogue.images(node)),
        dims=list(catalogue.dims(node)),
        prior_dims=[list(dims) for dims in node.prior_dims],
        quantiles_mm=quantile_table(catalogue.dims(node), catalogue.quantiles(node)),
        n_sources=prior.n_sources if prior else 0,
        share_by_kind=_shares(prior) if prior else {},
        borrowed=round(prior.borrowed, 4) if prior else 0.0,
        shipped=counts,
        children=[reference(catalogue, child) for child in node.children],
        links=_links(catalogue, node, len(rows)),
    )


def prior_answer(
    catalogue: ReleaseCatalogue,
    node: Node,
    prior: Prior,
    quantiles: tuple[float, ...] = QUANTILES,
    density_at: FloatArray | None = None,
) -> PriorAnswer:
    """A prior with its quantiles, and its log density at sizes (n, d) in mm where these are given."""
    table = prior.quantiles(quantiles)
    return PriorAnswer(
        tree=tree_reference(catalogue.tree),
        node=node.node_id,
        dims=list(prior.dims),
        tier=prior.tier,
        n=prior.n,
        n_sources=prior.n_sources,
        borrowed=round(prior.borrowed, 4),
        share_by_kind=_shares(prior),
        where=prior.note,
        quantiles_mm=quantile_table(prior.dims, table, quantiles),
        family=FAMILY,
        weights=prior.weights.tolist(),
        means=prior.means.tolist(),
        covariances=prior.covariances.tolist(),
        shared_covariance=prior.shared_covariance.tolist(),
        log_density=None if density_at is None else prior.log_density(density_at).tolist(),
    )


def page_count(rows: int) -> int:
    """Pages of items, one where there are none."""
    return max(1, -(-rows // PAGE_ROWS))


def cursor(page: int) -> str:
    """The token of a page of items; its form may change."""
    return urlsafe_b64encode(f"p{page}".encode()).decode().rstrip("=")


def page_of_cursor(token: str) -> int:
    """The page of a token.

    Raises
    ------
    InputError
        It is not a token of `cursor`.
    """
    try:
        text = urlsafe_b64decode(token + "=" * (-len(token) % 4)).decode()
    except ValueError:
        text = ""
    if not re.fullmatch(r"p[1-9]\d{0,5}", text):
        raise InputError(f"cursor: expected one that an answer gave as next; found {token[:40]!r}")
    return int(text[1:])


def items_answer(catalogue: ReleaseCatalogue, node: Node, page: int = 1) -> ItemsAnswer:
    """A page of the shipped items at or below a node, from 1."""
    rows = catalogue.rows(node)
    own = rows[(page - 1) * PAGE_ROWS : page * PAGE_ROWS]
    following = (
        f"v1/nodes/{slug(node.node_id)}/items?cursor={cursor(page + 1)}" if page < page_count(len(rows)) else None
    )
    return ItemsAnswer(
        tree=tree_reference(catalogue.tree),
        node=node.node_id,
        n_shipped=len(rows),
        items=[_stated(row) for row in catalogue.items.take(own).to_pylist()],
        next=following,
    )


def images_answer(catalogue: ReleaseCatalogue, node: Node) -> ImagesAnswer:
    """The images of items at or below a node."""
    images = catalogue.images(node)
    reference_ = tree_reference(catalogue.tree)
    return ImagesAnswer(tree=reference_, node=node.node_id, n_images=len(images), images=images[:MOST_IMAGES])


def search_answer(catalogue: ReleaseCatalogue, query: str, limit: int) -> SearchAnswer:
    """Nodes for what a person types, the likeliest first."""
    hits = []
    for node in catalogue.tree.search(query, limit):
        labels: dict[str, list[str]] = {}
        for name, label in catalogue.labels.get(node.node_id, ()):
            labels.setdefault(name, []).append(label)
        hits.append(SearchHit(node.node_id, node.name, list(node.path), catalogue.tier(node), node.n_items, labels))
    return SearchAnswer(tree=tree_reference(catalogue.tree), query=query, hits=hits)


def releases_answer(catalogue: ReleaseCatalogue) -> ReleasesAnswer:
    """The releases of the site: that at its root, and the others under `releases/VERSION/`."""
    return ReleasesAnswer(
        releases=[
            ReleaseRef(
                tree.name,
                tree.version,
                str(tree.release.manifest["created"]),
                "/" if tree is catalogue.main else f"/releases/{tree.version}/",
                dict(tree.release.manifest["counts"]),
            )
            for tree in sorted((catalogue.tree, *catalogue.others), key=lambda tree: tree is not catalogue.main)
        ]
    )


def vocabulary_answer(catalogue: ReleaseCatalogue, name: str) -> VocabularyAnswer:
    """Each label of a list with its node and the node's size."""
    rows = []
    for label in catalogue.vocabularies[name]:
        node = catalogue.nodes.get(label.node_id or "")
        if node is None:
            rows.append(VocabularyRow(label.label, None, label.reason, None, None, None, None))
            continue
        sizes = quantile_table(catalogue.dims(node), catalogue.quantiles(node)) or None
        tier = catalogue.tier(node)
        rows.append(VocabularyRow(label.label, node.node_id, label.reason, node.name, tier, node.n_items, sizes))
    return VocabularyAnswer(tree=tree_reference(catalogue.tree), vocabulary=name, labels=rows)


def outside_links(catalogue: ReleaseCatalogue, node: Node) -> dict[str, str]:
    """WordNet and Wikidata: the synset and the item themselves where their codes are known, else a search."""
    codes = catalogue.codes.get(node.node_id, [])
    offset = next((code for code in codes if code.startswith("n")), None)
    freebase = next((code for code in codes if code.startswith("/m/")), None)
    word = shown_name(node).replace(" ", "%20")
    links = {}
    if offset is not None:
        links["WordNet"] = f"http://wordnet-rdf.princeton.edu/pwn30/{offset[1:]}-n"
    elif node.synset is not None:
        links["WordNet"] = f"https://en-word.net/lemma/{word}"
    asked = f"haswbstatement:P646={freebase}" if freebase is not None else word
    links["Wikidata"] = f"https://www.wikidata.org/w/index.php?search={asked}"
    return links


def _links(catalogue: ReleaseCatalogue, node: Node, n_shipped: int) -> dict[str, str]:
    own = {
        "self": json_of(node.node_id),
        "page": page_of(node.node_id),
        "prior": prior_of(node.node_id),
        "items": items_of(node.node_id),
        "images": images_of(node.node_id),
    }
    if n_shipped and node.level >= LISTED_LEVEL:
        own["csv"] = csv_of(node.node_id)
        if n_shipped >= LEAST_PARQUET:
            own["parquet"] = parquet_of(node.node_id)
    return own | outside_links(catalogue, node)


def _line(node: Node) -> list[Node]:
    """The nodes from the root to this one."""
    return [*(_line(node.parent) if node.parent else ()), node]


def _stated(row: dict[str, Any]) -> dict[str, Any]:
    """The fields of an item that have a value."""
    return {name: value for name, value in row.items() if value is not None and value != []}


def _shares(prior: Prior) -> dict[str, float]:
    return {kind: round(share, 4) for kind, share in sorted(prior.share_by_kind.items(), key=lambda one: -one[1])}


def _counts(values: list[Any]) -> dict[str, int]:
    return dict(Counter("unstated" if value is None else str(value) for value in values).most_common())


def _rounded(mm: float) -> float:
    """Millimetres to five significant digits."""
    return float(f"{mm:.5g}")


def asked_search(catalogue: ReleaseCatalogue, query: str, limit: int) -> bytes:
    """Nodes for a text.

    Raises
    ------
    InputError
        The text is empty or too long, or the limit is out of range.
    """
    if not query.strip() or len(query) > LONGEST_NAME:
        raise InputError(f"q: expected 1 to {LONGEST_NAME} characters; found {len(query):,}")
    if not 1 <= limit <= MOST_HITS:
        raise InputError(f"limit: expected 1 to {MOST_HITS}; found {limit}")
    return msgspec.json.encode(search_answer(catalogue, query, limit))


def asked_prior(
    catalogue: ReleaseCatalogue,
    node: Node,
    dims: Sequence[str] = (),
    where: str | None = None,
    quantiles: Sequence[float] = QUANTILES,
    density_at: Sequence[float] = (),
) -> bytes:
    """A prior over any dimensions that the node has, in a context, with any quantiles and the density at sizes.

    density_at : sizes in mm, one number for each dimension and then the next size

    Raises
    ------
    InputError
        A number is out of range, or the context names nothing.
    NoPrior
        No prior has these dimensions.
    """
    if len(quantiles) > MOST_QUANTILES or not all(0 < q < 1 for q in quantiles):
        raise InputError(
            f"quantiles: expected at most {MOST_QUANTILES} numbers between 0 and 1; found {_shown(quantiles)}"
        )
    if len(set(dims)) != len(dims):
        raise InputError(f"dims: expected each once; found {', '.join(dims)}")
    prior = node.prior(tuple(dims) or None, where)
    d = len(prior.dims)
    if len(density_at) % d or len(density_at) > MOST_SIZES * d or not all(1e-6 < mm < 1e12 for mm in density_at):
        raise InputError(
            f"density_at: expected sizes in mm with {d} numbers each, at most {MOST_SIZES}; found {_shown(density_at)}"
        )
    sizes = np.array(density_at, dtype=float).reshape(-1, d) if density_at else None
    return msgspec.json.encode(prior_answer(catalogue, node, prior, tuple(quantiles), sizes))


def asked_items(catalogue: ReleaseCatalogue, node: Node, token: str | None) -> bytes | None:
    """A page of items by its cursor; None where there is no such page."""
    page = 1 if token is None else page_of_cursor(token)
    there = page <= page_count(len(catalogue.rows(node)))
    return msgspec.json.encode(items_answer(catalogue, node, page)) if there else None


def found_node(catalogue: ReleaseCatalogue, name: str, vocabulary: str | None = None) -> Node:
    """The node of an id, a slug, or of a name as the tree reads it; UnknownName if there is none."""
    if name in catalogue.nodes or name in catalogue.by_slug:
        return catalogue.node(name)
    return catalogue.tree.find(name, vocabulary)


def comparison(catalogue: ReleaseCatalogue, names: Sequence[str]) -> bytes:
    """Nodes side by side, each with its tier and quantiles in mm."""
    if not 1 <= len(names) <= MOST_COMPARED:
        raise InputError(f"nodes: expected 1 to {MOST_COMPARED} names; found {len(names)}")
    nodes = [found_node(catalogue, name) for name in names]
    rows: list[dict[str, Any]] = []
    for node in nodes:
        answer = node_answer(catalogue, node)
        rows.append({**msgspec.to_builtins(reference(catalogue, node)), "quantiles_mm": answer.quantiles_mm})
    return msgspec.json.encode({"schema": "metric-tree/comparison/1", "nodes": rows})


def listed_labels(catalogue: ReleaseCatalogue, name: str) -> bytes:
    """A label list with the sizes of its labels; InputError where there is none of the name."""
    if name not in catalogue.vocabularies:
        raise InputError(f"vocabulary: expected one of {', '.join(catalogue.vocabularies)}; found {name[:60]!r}")
    return msgspec.json.encode(vocabulary_answer(catalogue, name))


def numbers(text: str, field: str) -> list[float]:
    """The numbers of a text with commas; InputError where one is none."""
    if len(text) > LONGEST_LIST:
        raise InputError(f"{field}: expected at most {LONGEST_LIST:,} characters; found {len(text):,}")
    try:
        return [float(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise InputError(f"{field}: expected numbers with commas between them; found {text[:60]!r}") from None


def _shown(values: Sequence[float]) -> str:
    return f"{len(values)} numbers" if len(values) > 6 else ", ".join(f"{value:g}" for value in values) or "none"
