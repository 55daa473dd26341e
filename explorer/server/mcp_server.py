"""The six questions as tools of the Model Context Protocol, over standard input and output; all of them only read."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any

import msgspec
from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ToolError

from explorer.catalogue import ReleaseCatalogue
from explorer.responses import asked_prior, asked_search, comparison, found_node, listed_labels, node_answer
from explorer.schemas import ScaleRequest
from explorer.server.scale_jobs import scale_record
from metric_base.errors import InputError
from metric_tree.prior import QUANTILES
from metric_tree.tree import Tree


def tool_server(trees: Sequence[Tree]) -> MCPServer:
    """A server of the tools search, node, prior, compare, vocabulary and scale for the first of the releases."""
    catalogue = ReleaseCatalogue(trees)
    tree = catalogue.tree
    server = MCPServer(
        "metric-tree",
        instructions=f"Object sizes by category in millimetres, release {tree.version}. The tier of an answer says how "
        "well it is known: norm, measured, few, models, borrowed, judged (the last is a language model's range).",
    )

    def search(query: str, limit: int = 10) -> dict[str, Any]:
        """Categories for a text, the likeliest first."""
        return _read(asked_search(catalogue, query, limit))

    def node(name: str, vocabulary: str | None = None) -> dict[str, Any]:
        """A category by id or name (as a detector's label list means it, where one is named): sizes, tier, evidence."""
        answer: dict[str, Any] = msgspec.to_builtins(node_answer(catalogue, found_node(catalogue, name, vocabulary)))
        return answer

    def prior(
        name: str,
        dims: list[str] | None = None,
        where: str | None = None,
        quantiles: list[float] | None = None,
        density_at: list[float] | None = None,
    ) -> dict[str, Any]:
        """The size distribution of a category over ln mm; `where` is such as region=europe,year=2011."""
        found = found_node(catalogue, name)
        return _read(asked_prior(catalogue, found, dims or (), where, quantiles or QUANTILES, density_at or ()))

    def compare(names: list[str]) -> dict[str, Any]:
        """Up to six categories side by side."""
        return _read(comparison(catalogue, names))

    def vocabulary(name: str) -> dict[str, Any]:
        """A detector's label list (coco_80, lvis_v1, ...): each label, its category, tier and sizes."""
        return _read(listed_labels(catalogue, name))

    def scale(objects: list[dict[str, Any]], known_lengths: list[dict[str, float]] | None = None) -> dict[str, Any]:
        """Metres per unit, from objects in scene units: [{"category": "chair", "dimensions": {"height": 0.45}}]."""
        return scale_record(ScaleRequest(objects=objects, known_lengths=known_lengths or []), tree)

    for tool in (search, node, prior, compare, vocabulary, scale):
        server.add_tool(_refusing(tool))
    return server


def _refusing(tool: Callable[..., dict[str, Any]]) -> Callable[..., dict[str, Any]]:
    """The tool with errors of the input as the protocol has them: the agent reads the message and asks again."""

    @wraps(tool)
    def refuse(*args: Any, **values: Any) -> dict[str, Any]:
        try:
            return tool(*args, **values)
        except InputError as error:
            raise ToolError(str(error)) from None

    return refuse


def _read(answer: bytes) -> dict[str, Any]:
    record: dict[str, Any] = json.loads(answer)
    return record
