"""The OpenAPI description of the server, generated from the route table and the records of queries and responses."""

from __future__ import annotations

from typing import Any

import msgspec

from explorer.catalogue import ReleaseCatalogue
from explorer.routes import ROUTES, Route
from explorer.schemas import Problem, ScaleRequest

_EXAMPLE_REQUEST = {
    "schema": "metric-tree/objects/1",
    "objects": [
        {"id": "chair 1", "category": "chair", "dimensions": {"length": 0.27, "width": 0.26, "height": 0.45}},
        {"id": "mug 2", "category": "mug", "dimensions": {"height": 0.049}},
    ],
    "known_lengths": [{"units": 1.0, "metres": 2.0}],
}


def description(catalogue: ReleaseCatalogue) -> bytes:
    """Return the description of a server whose main release is that of the catalogue, as JSON."""
    described = [route for route in ROUTES if route.response is not None]
    records = [*(route.response for route in described), ScaleRequest, Problem]
    _, components = msgspec.json.schema_components(records, ref_template="#/components/schemas/{name}")
    example_node = "chair.n.01" if "chair.n.01" in catalogue.nodes else next(iter(catalogue.nodes))
    examples = {
        "id": ("a node's id or its slug", example_node),
        "name": ("a label list", next(iter(catalogue.vocabularies), "coco_80")),
    }
    document = {
        "openapi": "3.1.0",
        "info": {
            "title": f"{catalogue.tree.name} {catalogue.tree.version}",
            "version": catalogue.tree.version,
            "description": "Object sizes by category. Sizes are in millimetres. Each response except searches and "
            "queries is also a file of the static site, at the same path with `.json`. Other releases of the server "
            "are under `/releases/VERSION/`.",
            "license": {"name": "Apache-2.0 (code); each row of data under the licence that it names"},
        },
        "paths": {
            **{f"/{route.path.removesuffix('.json')}": {"get": _get(route, examples)} for route in described},
            "/v1/scale": {"post": _scale_operation()},
            "/healthz": {
                "get": {
                    "operationId": "health",
                    "summary": "State of the server.",
                    "responses": {"200": _content("application/json", {"type": "object"}, "the server is ready")},
                }
            },
        },
        "components": {"schemas": components},
    }
    return msgspec.json.encode(document)


def _get(route: Route, examples: dict[str, tuple[str, str]]) -> dict[str, Any]:
    parameters = []
    if route.parameter:
        text, example = examples[route.parameter]
        schema = {"type": "string", "minLength": 1}
        parameters.append(_parameter(route.parameter, "path", text, schema, example, required=True))
    if route.query is not None:
        _, records = msgspec.json.schema_components([route.query])
        query = records[route.query.__name__]
        for name, schema in query["properties"].items():
            if "description" in schema:  # a field without a description is a former name
                text, (example, *_) = schema.pop("description"), schema.pop("examples")
                if schema.get("default") == "":
                    del schema["default"]
                required = name in query["required"]
                parameters.append(_parameter(name, "query", text, schema, example, required))
    assert route.response is not None
    return {
        "operationId": route.operation,
        "summary": route.summary,
        "parameters": parameters,
        "responses": {
            "200": _content("application/json", _ref(route.response.__name__), "the record"),
            "404": _error("the release has no such name"),
            "422": _error("a parameter is invalid"),
        },
    }


def _scale_operation() -> dict[str, Any]:
    body = {"application/json": {"schema": _ref("ScaleRequest"), "example": _EXAMPLE_REQUEST}}
    errors = {"413": "the body is too long", "415": "the body is not JSON", "422": "a field is invalid", "503": "busy"}
    result = {"type": "object", "required": ["schema", "status"]}
    return {
        "operationId": "scale",
        "summary": "The posterior of the scale (metres per unit) from measured objects and known lengths.",
        "requestBody": {"required": True, "content": body},
        "responses": {
            "200": _content("application/json", result, "metric-tree/scale/1"),
            **{status: _error(text) for status, text in errors.items()},
        },
    }


def _parameter(
    name: str, place: str, text: str, schema: dict[str, Any], example: Any, required: bool
) -> dict[str, Any]:
    return {
        "name": name,
        "in": place,
        "description": text,
        "required": required,
        "schema": schema,
        "example": example,
    }


def _ref(record: str) -> dict[str, str]:
    return {"$ref": f"#/components/schemas/{record}"}


def _content(media_type: str, schema: dict[str, Any], text: str) -> dict[str, Any]:
    return {"description": text, "content": {media_type: {"schema": schema}}}


def _error(text: str) -> dict[str, Any]:
    return _content("application/problem+json", _ref("Problem"), text)
