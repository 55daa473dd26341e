"""Relative URLs of the pages and the data of a node, identical in the static site and on the server."""

from __future__ import annotations

#: Items on one page: about 12 kB of JSON. The static site has the first page only, and all items as CSV.
PAGE_ROWS = 50

#: Minimum number of items for a Parquet file; with fewer, its footer is longer than the rows.
MIN_PARQUET_ROWS = 50


def slug(node_id: str) -> str:
    """Return the id of a node as a file name.

    `mt:bar_stool` becomes `mt-bar_stool`, `chair.n.01/other` becomes `chair.n.01~other`.
    """
    return node_id.replace("/", "~").replace(":", "-")


def page_of(node_id: str) -> str:
    """Return the URL of the page of a node."""
    return f"nodes/{slug(node_id)}.html"
