"""Tools of the Model Context Protocol over standard input and output; all of them only read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from importlib.metadata import version
from typing import Annotated, Any

import msgspec
from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.types import ToolAnnotations
from pydantic import Field

from explorer.catalogue import ReleaseCatalogue
from explorer.fit import fit_response
from explorer.queries import search_response
from explorer.responses import comparison, found_node, node_response, queried_prior, vocabulary_response
from explorer.schemas import FitQuery, ScaleRequest, SearchQuery
from explorer.server.scale_jobs import scale_record
from metric_base.errors import InputError
from metric_tree.prior import QUANTILES
from metric_tree.tree import Tree

#: Maximum number of labels of a response; 100 labels of a list take about 60,000 characters.
MAX_LABELS = 100

_Name = Annotated[str, Field(description="id or name of a category, for example chair.n.01 or office chair")]
_VOCABULARY = Field(description="label list: coco_80, lvis_v1, ...")


def tool_server(trees: Sequence[Tree]) -> MCPServer:
    """Return a server with the tools search, node, prior, compare, fit, vocabulary and scale for the first release."""
    catalogue = ReleaseCatalogue(trees)
    tree = catalogue.tree
    server = MCPServer(
        "metric-tree",
        instructions=f"Object sizes by category in millimetres, release {tree.version}. The tier of a result describes "
        "its evidence: norm, measured, few, models, borrowed, judged (the last is a language model's range).",
        version=version("metric-tree"),
    )

    def search(
        query: Annotated[str, Field(description="text, for example tv 55 inch")],
        limit: Annotated[int, Field(description="maximum number of categories, 1 to 50")] = 10,
    ) -> object:
        """Categories for a text, the most likely first."""
        return search_response(catalogue, msgspec.convert({"q": query, "limit": limit}, SearchQuery))

    def node(name: _Name, vocabulary: Annotated[str | None, _VOCABULARY] = None) -> object:
        """A category by id or name (of a detector's label list, if one is given): sizes, tier, evidence."""
        return node_response(catalogue, found_node(catalogue, name, vocabulary))

    def prior(
        name: _Name,
        dims: Annotated[
            list[str] | None, Field(description="length, width, height or extent1, extent2, extent3; default: all")
        ] = None,
        where: Annotated[str | None, Field(description="region=europe,year=2011, or one of them")] = None,
        quantiles: Annotated[list[float] | None, Field(description="probabilities between 0 and 1")] = None,
        density_at: Annotated[
            list[float] | None, Field(description="sizes in mm, one number per dimension and then the next size")
        ] = None,
    ) -> object:
        """The size distribution of a category over ln mm, with quantiles in mm."""
        found = found_node(catalogue, name)
        return queried_prior(catalogue, found, dims or (), where, quantiles or QUANTILES, density_at or ())

    def compare(names: Annotated[list[str], Field(description="one to six ids or names of categories")]) -> object:
        """Up to six categories side by side."""
        return comparison(catalogue, names)

    def fit(
        object: Annotated[str, Field(description="name or id of a category, or sides: 210 x 95 x 85 cm")],  # noqa: A002
        into: Annotated[str, Field(description="the same of the larger object, for example door or car")],
        how: Annotated[str, Field(description="through or in; by default the category decides")] = "",
    ) -> object:
        """The probability that an object fits through an opening or into a container, with its reason."""
        return fit_response(catalogue, msgspec.convert({"object": object, "into": into, "how": how}, FitQuery))

    def vocabulary(
        name: Annotated[str, _VOCABULARY],
        offset: Annotated[int, Field(ge=0, description="number of labels to skip: next_offset of a response")] = 0,
        limit: Annotated[int, Field(ge=1, le=MAX_LABELS, description="maximum number of labels")] = MAX_LABELS,
    ) -> object:
        """Labels of a detector's list: each label, its category, tier and sizes. next_offset is null at the end."""
        record = msgspec.to_builtins(vocabulary_response(catalogue, name))
        labels, end = record["labels"], offset + limit
        next_offset = end if end < len(labels) else None
        return {**record, "labels": labels[offset:end], "n_labels": len(labels), "next_offset": next_offset}

    def scale(
        objects: Annotated[
            list[dict[str, Any]],
            Field(description='objects in scene units: [{"category": "chair", "dimensions": {"height": 0.45}}]'),
        ],
        known_lengths: Annotated[
            list[dict[str, float]] | None, Field(description='known lengths: [{"units": 1.0, "metres": 2.0}]')
        ] = None,
    ) -> object:
        """The scale of a scene in metres per unit, with its interval, from measured objects."""
        request = msgspec.convert({"objects": objects, "known_lengths": known_lengths or []}, ScaleRequest)
        return scale_record(request, tree)

    for tool in (search, node, prior, compare, fit, vocabulary, scale):
        server.add_tool(
            _with_records(tool),
            annotations=ToolAnnotations(read_only_hint=True, idempotent_hint=True, open_world_hint=False),
        )
    return server


def _with_records(tool: Callable[..., object]) -> Callable[..., dict[str, Any]]:
    """Return the tool with records as dictionaries, and input errors as `ToolError`, whose message agents receive."""

    @wraps(tool)
    def call(*args: Any, **values: Any) -> dict[str, Any]:
        try:
            fields: dict[str, Any] = msgspec.to_builtins(tool(*args, **values))
        except (InputError, msgspec.ValidationError) as error:
            raise ToolError(str(error)) from None
        return fields

    call.__annotations__["return"] = dict[str, Any]
    return call
