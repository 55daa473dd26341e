"""Tools of the Model Context Protocol over standard input and output; all of them only read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any

import msgspec
from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ToolError

from explorer.catalogue import ReleaseCatalogue
from explorer.responses import (
    comparison,
    found_node,
    node_response,
    queried_prior,
    search_response,
    vocabulary_response,
)
from explorer.schemas import ScaleRequest, SearchQuery
from explorer.server.scale_jobs import scale_record
from metric_base.errors import InputError
from metric_tree.prior import QUANTILES
from metric_tree.tree import Tree


def tool_server(trees: Sequence[Tree]) -> MCPServer:
    """Return a server with the tools search, node, prior, compare, vocabulary and scale for the first release."""
    catalogue = ReleaseCatalogue(trees)
    tree = catalogue.tree
    server = MCPServer(
        "metric-tree",
        instructions=f"Object sizes by category in millimetres, release {tree.version}. The tier of a result describes "
        "its evidence: norm, measured, few, models, borrowed, judged (the last is a language model's range).",
    )

    def search(query: str, limit: int = 10) -> dict[str, Any]:
        """Categories for a text, the most likely first."""
        return _fields(search_response(catalogue, msgspec.convert({"q": query, "limit": limit}, SearchQuery)))

    def node(name: str, vocabulary: str | None = None) -> dict[str, Any]:
        """A category by id or name (of a detector's label list, if one is given): sizes, tier, evidence."""
        return _fields(node_response(catalogue, found_node(catalogue, name, vocabulary)))

    def prior(
        name: str,
        dims: list[str] | None = None,
        where: str | None = None,
        quantiles: list[float] | None = None,
        density_at: list[float] | None = None,
    ) -> dict[str, Any]:
        """The size distribution of a category over ln mm; `where` is for example region=europe,year=2011."""
        found = found_node(catalogue, name)
        return _fields(queried_prior(catalogue, found, dims or (), where, quantiles or QUANTILES, density_at or ()))

    def compare(names: list[str]) -> dict[str, Any]:
        """Up to six categories side by side."""
        return _fields(comparison(catalogue, names))

    def vocabulary(name: str) -> dict[str, Any]:
        """A detector's label list (coco_80, lvis_v1, ...): each label, its category, tier and sizes."""
        return _fields(vocabulary_response(catalogue, name))

    def scale(objects: list[dict[str, Any]], known_lengths: list[dict[str, float]] | None = None) -> dict[str, Any]:
        """Metres per unit, from objects in scene units: [{"category": "chair", "dimensions": {"height": 0.45}}]."""
        return scale_record(ScaleRequest(objects=objects, known_lengths=known_lengths or []), tree)

    for tool in (search, node, prior, compare, vocabulary, scale):
        server.add_tool(_with_tool_errors(tool))
    return server


def _with_tool_errors(tool: Callable[..., dict[str, Any]]) -> Callable[..., dict[str, Any]]:
    """Return the tool with input errors as `ToolError`, whose message the agent receives."""

    @wraps(tool)
    def call(*args: Any, **values: Any) -> dict[str, Any]:
        try:
            return tool(*args, **values)
        except (InputError, msgspec.ValidationError) as error:
            raise ToolError(str(error)) from None

    return call


def _fields(record: msgspec.Struct) -> dict[str, Any]:
    fields: dict[str, Any] = msgspec.to_builtins(record)
    return fields
