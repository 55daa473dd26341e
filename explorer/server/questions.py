"""What a client may ask beyond the files: search, a prior in a context, a comparison; for HTTP and for tools alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from explorer.content.answers import (
    items_answer,
    node_answer,
    page_count,
    page_of_cursor,
    prior_answer,
    reference,
    search_answer,
    vocabulary_answer,
)
from explorer.content.release_catalogue import ReleaseCatalogue
from metric_base.errors import InputError
from metric_tree.prior import QUANTILES
from metric_tree.tree import LONGEST_NAME, Node

__all__ = ["asked_items", "asked_prior", "asked_search", "comparison", "found_node", "listed_labels", "numbers"]

#: Most hits of a search, quantiles and sizes of one question, nodes of a comparison: each some milliseconds at most.
MOST_HITS, MOST_QUANTILES, MOST_SIZES, MOST_COMPARED = 50, 50, 100, 6

#: Characters of a list of numbers.
LONGEST_LIST = 4000


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
