"""Responses about a release, as records: functions of a catalogue and a query, for HTTP, MCP and the static site."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from msgspec import structs

from explorer import schemas
from explorer.catalogue import ReleaseCatalogue
from explorer.charts.axis import length_text
from explorer.everyday_sizes import all_axes_text, axis_words
from explorer.urls import MIN_PARQUET_ROWS, PAGE_ROWS, page_of, slug
from metric_base.arrays import FloatArray, grouped
from metric_base.errors import InputError
from metric_tree.node import Node
from metric_tree.prior import FAMILY, MEDIAN, QUANTILES, Prior
from metric_tree.reports.description import MIXED_RATIO, is_heterogeneous, node_sentence
from metric_tree.reports.stated_axes import axis_names
from metric_tree.tree import Tree

#: Maximum number of images in a response, more than on a page.
MAX_IMAGES = 12
#: Maximum number of quantiles of a request; computing them takes a few milliseconds.
MAX_QUANTILES = 50
#: Maximum number of sizes at which a request evaluates the density.
MAX_DENSITY_SIZES = 100
#: Exclusive minimum and maximum of these sizes in mm, so that logarithms and densities are finite.
DENSITY_SIZE_RANGE_MM = (1e-6, 1e12)
#: Maximum number of narrower categories that an answer names, and the minimum ratio of their largest to their smallest
#: median: below it, they are nearly as large as the category.
MAX_NARROWER, MIN_NARROWER_RATIO = 4, 1.5
#: Maximum number of nodes in a comparison.
MAX_COMPARED = 6
#: Maximum length of a list of numbers in characters.
MAX_LIST_CHARS = 4000
#: Queries with the default value of every field.
DEFAULT_PRIOR, FIRST_ITEMS = schemas.PriorQuery(), schemas.ItemsQuery()
#: Maximum number of values that an error message repeats.
MAX_SHOWN_VALUES = 6


def tree_reference(tree: Tree) -> schemas.TreeRef:
    """Return name and version of a release."""
    return schemas.TreeRef(tree.name, tree.version)


def shown_name(node: Node) -> str:
    """Return the name of a node without the disambiguation in parentheses."""
    return node.name.partition(" (")[0]


def reference(catalogue: ReleaseCatalogue, node: Node) -> schemas.NodeRef:
    """Return the record of a node in a list."""
    return schemas.NodeRef(
        node.node_id,
        node.name,
        node.level,
        catalogue.tier(node),
        node.n_items,
        medians(catalogue, node),
        dict(axis_names(node)),
    )


def quantile_table(
    dims: tuple[str, ...], table: FloatArray, quantiles: Sequence[float] = QUANTILES
) -> schemas.Quantiles:
    """Return quantiles (q, d) in mm by dimension and probability."""
    return {
        dim: {f"{q:g}": _rounded(value) for q, value in zip(quantiles, column, strict=True)}
        for dim, column in zip(dims, table.T, strict=True)
    }


def sentence(catalogue: ReleaseCatalogue, node: Node) -> str:
    """Return sentences about the main size of a node, all its axes if there are several, and narrower categories."""
    prior = catalogue.prior(node)
    if prior is None:
        return "Nothing is known of its size."
    text = node_sentence(node, shown_name(node), prior)
    if not is_heterogeneous(node, prior):
        if len(prior.dims) > 1:
            text += f" All axes: {all_axes_text(node, medians(catalogue, node))}."
        text += narrower_text(catalogue, node)
    return text + (f" Height: {node.height_is}." if node.height_is else "")


def medians(catalogue: ReleaseCatalogue, node: Node) -> dict[str, float]:
    """Return the medians of the dimensions of a node in mm, with five digits."""
    values = map(_rounded, catalogue.quantiles(node)[MEDIAN].tolist())
    return dict(zip(catalogue.dims(node), values, strict=True))


def longest_axis(catalogue: ReleaseCatalogue, node: Node) -> str:
    """Return the dimension of a node with the largest median, empty without a prior."""
    sizes = medians(catalogue, node)
    return max(sizes, key=lambda dim: sizes[dim], default="")


def narrower_text(catalogue: ReleaseCatalogue, node: Node) -> str:
    """Return the medians of the subcategories with most items as a sentence, nothing if they are similar."""
    axis = longest_axis(catalogue, node)
    known = [child for child in node.children if axis in catalogue.dims(child) and not child.node_id.endswith("/other")]
    shown = sorted(known, key=lambda child: (-child.n_items, child.node_id))[:MAX_NARROWER]
    sizes = [medians(catalogue, child)[axis] for child in shown]
    if node.stated is not None or max(sizes, default=0) < MIN_NARROWER_RATIO * min(sizes, default=1):
        return ""
    texts = [f"{shown_name(child)} {length_text(mm, max(sizes))}" for child, mm in zip(shown, sizes, strict=True)]
    return f" Narrower: {', '.join(texts)} {axis_words(node)[axis]}."


def size_answer(catalogue: ReleaseCatalogue, node: Node, is_taken: bool) -> str:
    """Return the answer of a search: name, medians and tier of a node, and its narrower categories.

    `is_taken` states that the text of the search is not a name of the node.
    """
    stated = f", {node.stated.name}" if node.stated is not None else ""
    start = f"{'Taken as ' if is_taken else ''}{shown_name(node)}{stated}: "
    prior = catalogue.prior(node)
    if prior is None:
        return f"{start}nothing is known of its size."
    if is_heterogeneous(node, prior):
        return f"{start}sizes differ by more than {MIXED_RATIO:g} times; choose a narrower category."
    sizes = all_axes_text(node, medians(catalogue, node))
    return f"{start}{sizes} ({catalogue.tier(node)}).{narrower_text(catalogue, node)}"


def labels_by_list(catalogue: ReleaseCatalogue, node: Node) -> dict[str, list[str]]:
    """Return the labels of a node by the name of their label list."""
    return grouped(catalogue.labels.get(node.node_id, ()))


def node_response(catalogue: ReleaseCatalogue, node: Node, _: schemas.NoQuery | None = None) -> schemas.NodeAnswer:
    """Return the record of a category: position in the tree, sizes and evidence."""
    prior = catalogue.prior(node)
    rows = catalogue.rows(node)
    shipped = catalogue.published(rows)
    counts = {
        name: dict(Counter(value or "unstated" for value in shipped[name].to_pylist()).most_common())
        for name in ("kind", "licence", "source", "region")
    }
    url = f"v1/nodes/{slug(node.node_id)}"
    links = {"self": f"{url}.json", "page": page_of(node.node_id)}
    if prior is not None:
        links |= {"prior": f"{url}/prior.json", "sizes": f"{url}/sizes.csv"}
    if len(rows):
        links |= {"items": f"{url}/items.json", "csv": f"{url}/items.csv"}
        if len(rows) >= MIN_PARQUET_ROWS:
            links["parquet"] = f"{url}/items.parquet"
    if catalogue.images(node):
        links["images"] = f"{url}/images.json"
    return schemas.NodeAnswer(
        **structs.asdict(reference(catalogue, node)),
        tree=tree_reference(catalogue.tree),
        synset=node.synset,
        path=list(node.path),
        path_ids=[one.node_id for one in (node, *node.ancestors())][::-1],
        aliases=list(node.aliases),
        labels=labels_by_list(catalogue, node),
        pose=node.pose,
        sentence=sentence(catalogue, node),
        note=node.note,
        n_shipped=len(rows),
        n_images=len(catalogue.images(node)),
        dims=list(catalogue.dims(node)),
        prior_dims=[list(dims) for dims in node.prior_dims],
        quantiles_mm=quantile_table(catalogue.dims(node), catalogue.quantiles(node)),
        n_sources=prior.n_sources if prior else 0,
        sources=list(node.sources),
        share_by_kind=_shares(prior) if prior else {},
        borrowed=round(prior.borrowed, 4) if prior else 0.0,
        shipped=counts,
        children=[reference(catalogue, child) for child in node.children],
        links=links | outside_links(catalogue, node),
    )


def items_response(
    catalogue: ReleaseCatalogue, node: Node, query: schemas.ItemsQuery = FIRST_ITEMS
) -> schemas.ItemsAnswer | None:
    """Return a page of the published items at or below a node; None if there is no such page."""
    page = int((query.cursor or query.page or "p1")[1:])
    rows = catalogue.rows(node)
    n_pages = max(1, -(-len(rows) // PAGE_ROWS))
    if page > n_pages:
        return None
    items = catalogue.published(rows[(page - 1) * PAGE_ROWS : page * PAGE_ROWS]).to_pylist()
    return schemas.ItemsAnswer(
        tree=tree_reference(catalogue.tree),
        node=node.node_id,
        n_shipped=len(rows),
        items=[{name: value for name, value in item.items() if value is not None and value != []} for item in items],
        next=f"items?cursor=p{page + 1}" if page < n_pages else None,
    )


def images_response(catalogue: ReleaseCatalogue, node: Node, _: schemas.NoQuery | None = None) -> schemas.ImagesAnswer:
    """Return the first `MAX_IMAGES` images of items at or below a node."""
    images = catalogue.images(node)
    return schemas.ImagesAnswer(
        tree=tree_reference(catalogue.tree), node=node.node_id, n_images=len(images), images=images[:MAX_IMAGES]
    )


def releases_response(catalogue: ReleaseCatalogue) -> schemas.ReleasesAnswer:
    """Return the releases of the site: the main one at the root, the others under `releases/VERSION/`."""
    return schemas.ReleasesAnswer(
        releases=[
            schemas.ReleaseRef(
                tree.name,
                tree.version,
                str(tree.release.manifest["created"]),
                "/" if tree is catalogue.main else f"/releases/{tree.version}/",
                dict(tree.release.manifest["counts"]),
            )
            for tree in sorted((catalogue.tree, *catalogue.others), key=lambda tree: tree is not catalogue.main)
        ]
    )


def vocabulary_response(catalogue: ReleaseCatalogue, name: str) -> schemas.VocabularyAnswer:
    """Return each label of a list with its node and the size of the node. Raises InputError for an unknown list."""
    if name not in catalogue.vocabularies:
        raise InputError(f"vocabulary: expected one of {', '.join(catalogue.vocabularies)}; found {name[:60]!r}")
    rows = []
    for label in catalogue.vocabularies[name]:
        node = catalogue.nodes.get(label.node_id or "")
        if node is None:
            rows.append(schemas.VocabularyRow(label.label, None, label.reason, None, None, None, None))
            continue
        sizes = quantile_table(catalogue.dims(node), catalogue.quantiles(node)) or None
        facts = (node.name, catalogue.tier(node), node.n_items, sizes, dict(axis_names(node)))
        rows.append(schemas.VocabularyRow(label.label, node.node_id, label.reason, *facts))
    return schemas.VocabularyAnswer(tree=tree_reference(catalogue.tree), vocabulary=name, labels=rows)


def outside_links(catalogue: ReleaseCatalogue, node: Node) -> dict[str, str]:
    """Return links to WordNet and Wikidata: to the entry if its code is known, otherwise to a search."""
    codes = catalogue.codes.get(node.node_id, [])
    offset = next((code for code in codes if code.startswith("n")), None)
    freebase = next((code for code in codes if code.startswith("/m/")), None)
    word = shown_name(node).replace(" ", "%20")
    links = {}
    if offset is not None:
        links["WordNet"] = f"http://wordnet-rdf.princeton.edu/pwn30/{offset[1:]}-n"
    elif node.synset is not None:
        links["WordNet"] = f"https://en-word.net/lemma/{word}"
    search = f"haswbstatement:P646={freebase}" if freebase is not None else word
    links["Wikidata"] = f"https://www.wikidata.org/w/index.php?search={search}"
    return links


def _shares(prior: Prior) -> dict[str, float]:
    return {kind: round(share, 4) for kind, share in sorted(prior.share_by_kind.items(), key=lambda entry: -entry[1])}


def _rounded(mm: float) -> float:
    """Round a length in mm to five significant digits."""
    return float(f"{mm:.5g}")


def prior_response(
    catalogue: ReleaseCatalogue, node: Node, query: schemas.PriorQuery = DEFAULT_PRIOR
) -> schemas.PriorAnswer | None:
    """Return the prior that a query describes; None if the node has no prior.

    Raises
    ------
    InputError
        A number is invalid or out of range, or the context is unknown.
    NoPrior
        No prior has these dimensions.
    """
    dims = tuple(dim.strip() for dim in query.dims.split(",") if dim.strip())
    quantiles = numbers(query.q or query.quantiles, "quantiles")
    density_at = numbers(query.density_at, "density_at")
    return queried_prior(catalogue, node, dims, query.where or None, quantiles, density_at) if node.prior_dims else None


def queried_prior(
    catalogue: ReleaseCatalogue,
    node: Node,
    dims: Sequence[str] = (),
    where: str | None = None,
    quantiles: Sequence[float] = QUANTILES,
    density_at: Sequence[float] = (),
) -> schemas.PriorAnswer:
    """Return a prior over any dimensions of a node in a context, with quantiles and densities.

    Parameters
    ----------
    dims : sequence of str
        Dimensions; empty for those of the default prior, or else of the widest one.
    where : str, optional
        Region and year, `region=europe,year=2011`.
    quantiles : sequence of float
        Probabilities between 0 and 1, at most `MAX_QUANTILES`.
    density_at : sequence of float
        Sizes in mm, one number for each dimension and then the next size; at most `MAX_DENSITY_SIZES` sizes.

    Raises
    ------
    InputError
        A number is out of range, or the context is unknown.
    NoPrior
        No prior has these dimensions.
    """
    if len(quantiles) > MAX_QUANTILES or not all(0 < q < 1 for q in quantiles):
        expected = f"at most {MAX_QUANTILES} numbers between 0 and 1"
        raise InputError(f"quantiles: expected {expected}; found {_shown(quantiles)}")
    if len(set(dims)) != len(dims):
        raise InputError(f"dims: expected each dimension once; found {', '.join(dims)}")
    prior = node.prior(tuple(dims) or catalogue.dims(node) or None, where)
    d = len(prior.dims)
    low, high = DENSITY_SIZE_RANGE_MM
    if len(density_at) % d or len(density_at) > MAX_DENSITY_SIZES * d or not all(low < mm < high for mm in density_at):
        expected = f"sizes in mm with {d} numbers each, at most {MAX_DENSITY_SIZES}"
        raise InputError(f"density_at: expected {expected}; found {_shown(density_at)}")
    sizes = np.array(density_at, dtype=float).reshape(-1, d)
    return schemas.PriorAnswer(
        tree=tree_reference(catalogue.tree),
        node=node.node_id,
        dims=list(prior.dims),
        axis_names=dict(axis_names(node)),
        tier=prior.tier,
        n=prior.n,
        n_sources=prior.n_sources,
        borrowed=round(prior.borrowed, 4),
        share_by_kind=_shares(prior),
        where=prior.note,
        quantiles_mm=quantile_table(prior.dims, prior.quantiles(quantiles), quantiles),
        family=FAMILY,
        weights=prior.weights.tolist(),
        means=prior.means.tolist(),
        covariances=prior.covariances.tolist(),
        shared_covariance=prior.shared_covariance.tolist(),
        log_density=prior.log_density(sizes).tolist() if density_at else None,
    )


def found_node(catalogue: ReleaseCatalogue, name: str, vocabulary: str | None = None) -> Node:
    """Return the node of an id, a slug or a name. Raises UnknownName if there is none."""
    return catalogue.nodes.get(name) or catalogue.by_slug.get(name) or catalogue.tree.find(name, vocabulary)


def comparison(catalogue: ReleaseCatalogue, names: Sequence[str]) -> schemas.ComparisonAnswer:
    """Return nodes side by side, each with its tier and its quantiles in mm. Raises InputError for too many names."""
    if not 1 <= len(names) <= MAX_COMPARED:
        raise InputError(f"nodes: expected 1 to {MAX_COMPARED} names; found {len(names)}")
    return schemas.ComparisonAnswer(
        nodes=[
            schemas.ComparedNode(
                **structs.asdict(reference(catalogue, node)),
                quantiles_mm=quantile_table(catalogue.dims(node), catalogue.quantiles(node)),
            )
            for node in [found_node(catalogue, name) for name in names]
        ]
    )


def numbers(text: str, field: str) -> list[float]:
    """Return the numbers of a list with commas. Raises InputError if the text is too long or not a list of numbers."""
    if len(text) > MAX_LIST_CHARS:
        raise InputError(f"{field}: expected at most {MAX_LIST_CHARS:,} characters; found {len(text):,}")
    try:
        return [float(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise InputError(f"{field}: expected numbers with commas between them; found {text[:60]!r}") from None


def _shown(values: Sequence[float]) -> str:
    if len(values) > MAX_SHOWN_VALUES:
        return f"{len(values)} numbers"
    return ", ".join(f"{value:g}" for value in values) or "none"
