"""Addresses of pages and answers: one relative path for each, the same in the static site and on the server."""

from __future__ import annotations

#: Rows of one page of items: some 12 kB of JSON. The static site has the first page; the CSV beside it has all.
PAGE_ROWS = 50

#: From this level down a node's items are a CSV file of the static site; those of a node above it are its children's.
LISTED_LEVEL = 4

#: Items from which a node's are a Parquet file too: of fewer its footer is longer than the rows.
LEAST_PARQUET = 50


def slug(node_id: str) -> str:
    """A node's id as a file name: `mt:bar_stool` is `mt-bar_stool`, `chair.n.01/other` is `chair.n.01~other`."""
    return node_id.replace("/", "~").replace(":", "-")


def page_of(node_id: str) -> str:
    """The page of a node."""
    return f"nodes/{slug(node_id)}.html"


def json_of(node_id: str) -> str:
    """The JSON of a node."""
    return f"v1/nodes/{slug(node_id)}.json"


def prior_of(node_id: str) -> str:
    """The JSON of a node's default prior."""
    return f"v1/nodes/{slug(node_id)}/prior.json"


def items_of(node_id: str) -> str:
    """The JSON of the first page of a node's items."""
    return f"v1/nodes/{slug(node_id)}/items.json"


def images_of(node_id: str) -> str:
    """The JSON of a node's images."""
    return f"v1/nodes/{slug(node_id)}/images.json"


def csv_of(node_id: str) -> str:
    """The items of a node as CSV."""
    return f"v1/nodes/{slug(node_id)}/items.csv"


def parquet_of(node_id: str) -> str:
    """The items of a node as Parquet."""
    return f"v1/nodes/{slug(node_id)}/items.parquet"
