"""The OpenAPI description of the server, made from the records of its answers."""

from __future__ import annotations

from typing import Any

import msgspec

from explorer.catalogue import ReleaseCatalogue
from explorer.responses import MOST_HITS
from explorer.schemas import (
    ImagesAnswer,
    ItemsAnswer,
    NodeAnswer,
    PriorAnswer,
    Problem,
    ReleasesAnswer,
    ScaleRequest,
    SearchAnswer,
    VocabularyAnswer,
)

_RECORDS = (
    ReleasesAnswer, SearchAnswer, NodeAnswer, PriorAnswer, ItemsAnswer, ImagesAnswer, VocabularyAnswer, ScaleRequest,
    Problem,
)  # fmt: skip

_EXAMPLE_REQUEST = {
    "schema": "metric-tree/objects/1",
    "objects": [
        {"id": "chair 1", "category": "chair", "dimensions": {"length": 0.27, "width": 0.26, "height": 0.45}},
        {"id": "mug 2", "category": "mug", "dimensions": {"height": 0.049}},
    ],
    "known_lengths": [{"units": 1.0, "metres": 2.0}],
}


def description(catalogue: ReleaseCatalogue) -> bytes:
    """The description as JSON."""
    _, components = msgspec.json.schema_components(_RECORDS, ref_template="#/components/schemas/{name}")
    node = next(iter(catalogue.nodes.values()))
    example = "chair.n.01" if "chair.n.01" in catalogue.nodes else node.node_id
    vocabulary = next(iter(catalogue.vocabularies), "coco_80")
    node_id = _parameter("id", "path", "a node's id or its slug", {"type": "string", "minLength": 1}, example)
    name = _parameter("name", "path", "a label list", {"type": "string", "minLength": 1}, vocabulary)
    document = {
        "openapi": "3.1.0",
        "info": {
            "title": f"{catalogue.tree.name} {catalogue.tree.version}",
            "version": catalogue.tree.version,
            "description": "Object sizes by category. Sizes are in millimetres. Each answer is also a file of the "
            "static site, at the same path with `.json`. Other releases of the server are under `/releases/VERSION/`.",
            "license": {"name": "Apache-2.0 (code); each row of data under the licence that it names"},
        },
        "paths": {
            "/v1/releases": {"get": _get("releases", "The releases of this server.", [], "ReleasesAnswer")},
            "/v1/search": {"get": _get("search", "Nodes for a text, the likeliest first.", _search(), "SearchAnswer")},
            "/v1/nodes/{id}": {"get": _get("node", "A category.", [node_id], "NodeAnswer")},
            "/v1/nodes/{id}/prior": {
                "get": _get("prior", "Its size distribution.", [node_id, *_prior()], "PriorAnswer")
            },
            "/v1/nodes/{id}/items": {
                "get": _get("items", "Its shipped items, a page at a time.", [node_id, _cursor()], "ItemsAnswer")
            },
            "/v1/nodes/{id}/images": {"get": _get("images", "Pictures of its items.", [node_id], "ImagesAnswer")},
            "/v1/vocabularies/{name}": {
                "get": _get("vocabulary", "A label list with sizes.", [name], "VocabularyAnswer")
            },
            "/v1/scale": {"post": _post()},
            "/healthz": {
                "get": {
                    "operationId": "health",
                    "summary": "That the server answers.",
                    "responses": {"200": _content("application/json", {"type": "object"}, "it does")},
                }
            },
        },
        "components": {"schemas": components},
    }
    return msgspec.json.encode(document)


def _get(operation: str, summary: str, parameters: list[dict[str, Any]], record: str) -> dict[str, Any]:
    responses = {"200": _content("application/json", _ref(record), "the answer")}
    responses |= {"404": _error("nothing has this name"), "422": _error("a parameter is invalid")}
    return {"operationId": operation, "summary": summary, "parameters": parameters, "responses": responses}


def _post() -> dict[str, Any]:
    body = {"application/json": {"schema": _ref("ScaleRequest"), "example": _EXAMPLE_REQUEST}}
    errors = {"413": "the body is too long", "415": "the body is not JSON", "422": "a field is invalid", "503": "busy"}
    return {
        "operationId": "scale",
        "summary": "The posterior of the scale (metres per unit) from measured objects and known lengths.",
        "requestBody": {"required": True, "content": body},
        "responses": {
            "200": _content(
                "application/json", {"type": "object", "required": ["schema", "status"]}, "metric-tree/scale/1"
            ),
            **{status: _error(text) for status, text in errors.items()},
        },
    }


def _search() -> list[dict[str, Any]]:
    limit = {"type": "integer", "minimum": 1, "maximum": MOST_HITS, "default": 10}
    return [
        {
            **_parameter(
                "q", "query", "what a person types", {"type": "string", "minLength": 1, "maxLength": 300}, "chair"
            ),
            "required": True,
        },
        _parameter("limit", "query", "most hits", limit, 5),
    ]


def _prior() -> list[dict[str, Any]]:
    text = {"type": "string"}
    return [
        _parameter(
            "dims",
            "query",
            "dimensions with commas: length, width, height or extent1, extent2, extent3",
            text,
            "height",
        ),
        _parameter("where", "query", "region and year, either or both", text, "region=europe,year=2011"),
        _parameter("quantiles", "query", "numbers between 0 and 1 with commas", text, "0.05,0.5,0.95"),
        _parameter(
            "density_at", "query", "sizes in mm, a number for each dimension and then the next size", text, "900,950"
        ),
    ]


def _cursor() -> dict[str, Any]:
    return _parameter("cursor", "query", "the token in the `next` of the page before", {"type": "string"}, "cDE")


def _parameter(name: str, place: str, text: str, schema: dict[str, Any], example: Any) -> dict[str, Any]:
    return {
        "name": name,
        "in": place,
        "description": text,
        "required": place == "path",
        "schema": schema,
        "example": example,
    }


def _ref(record: str) -> dict[str, str]:
    return {"$ref": f"#/components/schemas/{record}"}


def _content(kind: str, schema: dict[str, Any], text: str) -> dict[str, Any]:
    return {"description": text, "content": {kind: {"schema": schema}}}


def _error(text: str) -> dict[str, Any]:
    return _content("application/problem+json", _ref("Problem"), text)
