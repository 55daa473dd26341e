"""The route table: every address of a release with its content, for the static site, the server and OpenAPI."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib.resources import files
from typing import Any

import msgspec

from explorer import responses, schemas, tables
from explorer.catalogue import ReleaseCatalogue
from explorer.fit import fit_response
from explorer.pages import release_pages as pages
from explorer.pages.node_page import node_page
from explorer.pages.templating import page_bytes
from explorer.queries import search_response
from explorer.route import Route
from explorer.search_index import name_index, size_index

ASSETS = ("style.css", "page.js", "search.js", "compare.js", "scale.js", "view3d.js", "icon.svg")

#: Values of each path parameter in a static site, keyed by their text in the URL. The server also accepts the id of a
#: node, which may contain "/" and ":", for `id`. Addresses without a parameter have the key `""`.
PARAMETERS: dict[str, Callable[[ReleaseCatalogue], Mapping[str, Any]]] = {
    "": lambda _: {"": None},
    "source": lambda catalogue: {source: source for source in catalogue.sources},
    "version": lambda catalogue: {tree.version: tree for tree in catalogue.others},
    "name": lambda catalogue: {name: name for name in catalogue.vocabularies},
    "slug": lambda catalogue: catalogue.by_slug,
    "id": lambda catalogue: catalogue.by_slug,
}


def _asset(name: str, _: ReleaseCatalogue) -> bytes:
    return files("explorer.pages").joinpath("assets", name).read_bytes()


def _plain_page(template: str, title: str, catalogue: ReleaseCatalogue) -> bytes:
    """Return a page whose text is equal for all releases, or that scripts fill."""
    return page_bytes(catalogue, template, "", title)


def openapi_description(catalogue: ReleaseCatalogue) -> bytes:
    """Return the OpenAPI description of the addresses of a release, from the route table and the records, as JSON.

    `openapi_base.json` describes the API in general and the two addresses that are not in the route table.
    """
    described = [route for route in ROUTES if route.response is not None]
    records = [*(route.response for route in described), schemas.ScaleRequest, schemas.Problem]
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
    replies = {"200": _content("application/json", route.response, "the record")}
    for status, text in (("404", "the release has no such name"), ("422", "a parameter is invalid")):
        replies[status] = _content("application/problem+json", schemas.Problem, text)
    return {
        "operationId": route.response.__name__.removesuffix("Answer").lower(),
        "summary": str(route.response.__doc__).partition("\n")[0],
        "parameters": [dict(zip(keys, field, strict=True)) for field in fields],
        "responses": replies,
    }


def _content(media_type: str, record: type[msgspec.Struct], text: str) -> dict[str, Any]:
    schema = {"$ref": f"#/components/schemas/{record.__name__}"}
    return {"description": text, "content": {media_type: {"schema": schema}}}


#: The first route whose pattern matches an address serves it.
ROUTES: tuple[Route, ...] = (
    Route("index.html", pages.home_page),
    Route("openapi.json", openapi_description),
    Route("tree.html", pages.tree_page),
    Route("about.html", partial(_plain_page, "about.html", "About these sizes")),
    Route("compare.html", partial(_plain_page, "compare.html", "Compare")),
    Route("search.html", partial(_plain_page, "search.html", "Search")),
    Route("scale.html", partial(_plain_page, "scale.html", "The scale of a scene")),
    Route("sources/index.html", pages.sources_page),
    Route("sources/{source}.html", pages.source_page),
    Route("changes/{version}.html", pages.change_page),
    Route("vocabularies/index.html", pages.vocabularies_page),
    Route("vocabularies/{name}.html", pages.vocabulary_page),
    Route("vocabularies/{name}.csv", tables.vocabulary_csv),
    Route("assets/names.js", name_index),
    Route("assets/sizes.js", size_index),
    *(Route(f"assets/{name}", partial(_asset, name)) for name in ASSETS),
    Route("nodes/{slug}.html", node_page),
    Route("v1/releases.json", responses.releases_response, None, schemas.ReleasesAnswer),
    Route("v1/search", search_response, schemas.SearchQuery, schemas.SearchAnswer, is_static=False),
    Route("v1/fit", fit_response, schemas.FitQuery, schemas.FitAnswer, is_static=False),
    Route("v1/sizes.csv", lambda of: tables.csv_bytes(tables.sizes_table(of))),
    Route("v1/sizes.parquet", lambda of: tables.parquet_bytes(tables.sizes_table(of))),
    Route("v1/nodes/{slug}/sizes.csv", tables.node_sizes_csv),
    Route("v1/nodes/{slug}/items.csv", tables.items_csv),
    Route("v1/nodes/{slug}/items.parquet", tables.items_parquet),
    Route("v1/nodes/{id}/prior.json", responses.prior_response, schemas.PriorQuery, schemas.PriorAnswer, is_quick=True),
    Route("v1/nodes/{id}/items.json", responses.items_response, schemas.ItemsQuery, schemas.ItemsAnswer),
    Route("v1/nodes/{id}/images.json", responses.images_response, schemas.NoQuery, schemas.ImagesAnswer),
    Route("v1/nodes/{id}.json", responses.node_response, schemas.NoQuery, schemas.NodeAnswer),
    Route("v1/vocabularies/{name}.json", responses.vocabulary_response, None, schemas.VocabularyAnswer),
)


def find_route(catalogue: ReleaseCatalogue, address: str) -> tuple[Route, str, Any] | None:
    """Return the route of an address, the text of its parameter and its value; None if the address does not exist.

    Raises
    ------
    UnknownName
        The release has no node of the address. JSON of a node is also found by the name of the node.
    """
    for route in ROUTES:
        match = route.pattern.fullmatch(address)
        if match is None:
            continue
        text = match[1] if route.parameter else ""
        if route.parameter == "id":
            return route, text, responses.found_node(catalogue, text)
        values = PARAMETERS[route.parameter](catalogue)
        return (route, text, values[text]) if text in values else None
    return None


def render(catalogue: ReleaseCatalogue, address: str) -> bytes | None:
    """Return the content of an address of a release (`nodes/chair.n.01.html`), None if the address does not exist.

    Raises
    ------
    UnknownName
        The release has no node of the address.
    """
    found = find_route(catalogue, address)
    return None if found is None else found[0].content(catalogue, found[2])


def site_addresses(catalogue: ReleaseCatalogue) -> Iterator[str]:
    """Yield every address of the static site except those of images, grouped by parameter value.

    Some have no content, such as the items of a node without any.
    """
    for parameter, values in PARAMETERS.items():
        routes = [route for route in ROUTES if route.is_static and route.parameter == parameter]
        for text in values(catalogue):
            for route in routes:
                yield route.path.replace(f"{{{parameter}}}", text)
