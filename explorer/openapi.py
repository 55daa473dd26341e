"""The OpenAPI description of the server, generated from the route table and the records of queries and responses."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import msgspec

from explorer.catalogue import ReleaseCatalogue
from explorer.route import Route
from explorer.schemas import Problem, ScaleRequest


def description(catalogue: ReleaseCatalogue, routes: Sequence[Route]) -> bytes:
    """Return the description of the addresses of a release as JSON.

    `openapi_base.json` describes the API in general and the two addresses that are not in the route table.
    """
    described = [route for route in routes if route.response is not None]
    records = [*(route.response for route in described), ScaleRequest, Problem]
    _, components = msgspec.json.schema_components(records, ref_template="#/components/schemas/{name}")
    example_node = "chair.n.01" if "chair.n.01" in catalogue.nodes else next(iter(catalogue.nodes))
    examples = {
        "id": ("an id, a slug or a name of a category", example_node),
        "name": ("a label list", next(iter(catalogue.vocabularies), "coco_80")),
    }
    document = msgspec.json.decode(files("explorer").joinpath("openapi_base.json").read_bytes())
    document["info"]["title"] = f"{catalogue.tree.name} {catalogue.tree.version}"
    document["info"]["version"] = catalogue.tree.version
    paths = {f"/{route.path.removesuffix('.json')}": {"get": operation(route, examples)} for route in described}
    document["paths"] = paths | document["paths"]
    document["components"]["schemas"] = components
    return msgspec.json.encode(document)


def operation(route: Route, examples: dict[str, tuple[str, str]]) -> dict[str, Any]:
    """Return the operation of a route; `examples` has the description and an example of each path parameter."""
    fields = []
    if route.parameter:
        text, example = examples[route.parameter]
        fields.append((route.parameter, "path", text, True, {"type": "string", "minLength": 1}, example))
    if route.query is not None:
        _, records = msgspec.json.schema_components([route.query])
        query = records[route.query.__name__]
        for name, schema in query["properties"].items():
            if "description" in schema:  # a field without a description is a former name
                text, (example, *_) = schema.pop("description"), schema.pop("examples")
                if schema.get("default") == "":
                    del schema["default"]
                fields.append((name, "query", text, name in query["required"], schema, example))
    keys = ("name", "in", "description", "required", "schema", "example")
    assert route.response is not None
    responses = {"200": _content("application/json", route.response, "the record")}
    for status, text in (("404", "the release has no such name"), ("422", "a parameter is invalid")):
        responses[status] = _content("application/problem+json", Problem, text)
    return {
        "operationId": route.operation,
        "summary": str(route.response.__doc__).partition("\n")[0],
        "parameters": [dict(zip(keys, field, strict=True)) for field in fields],
        "responses": responses,
    }


def _content(media_type: str, record: type[msgspec.Struct], text: str) -> dict[str, Any]:
    schema = {"$ref": f"#/components/schemas/{record.__name__}"}
    return {"description": text, "content": {media_type: {"schema": schema}}}
