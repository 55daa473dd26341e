"""An address of a release: its pattern, the record of its query string, and the function that renders it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec

from explorer.catalogue import ReleaseCatalogue
from metric_base.errors import InputError

MEDIA_TYPES = {
    "html": "text/html; charset=utf-8",
    "json": "application/json",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
    "csv": "text/csv; charset=utf-8",
    "parquet": "application/vnd.apache.parquet",
    "webp": "image/webp",
    "jpg": "image/jpeg",
    "png": "image/png",
}


@dataclass(frozen=True)
class Route:
    """An address of a release, with at most one parameter in braces (a key of `explorer.routes.PARAMETERS`).

    `render` is called with the catalogue, the value of the parameter if there is one, and the query if `query` is a
    record. It returns bytes, a record to encode as JSON, or None if the address does not exist.
    """

    path: str
    render: Callable[..., bytes | msgspec.Struct | None]
    query: type[msgspec.Struct] | None = None  #: record of the query string; None: a query string is ignored
    response: type[msgspec.Struct] | None = None  #: record of the response; None: not described by OpenAPI
    is_static: bool = True  #: False if only a server has the address
    is_quick: bool = False  #: Rendering takes less time than a switch of threads.

    @cached_property
    def parameter(self) -> str:
        """Name of the parameter, empty if there is none."""
        return self.path.partition("{")[2].partition("}")[0]

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """Pattern of the addresses; the suffix `.json` is optional."""
        text = re.escape(self.path).replace(r"\{id\}", "(.+?)")
        text = re.sub(r"\\\{\w+\\\}", "([^/]+?)", text)
        return re.compile(re.sub(r"\\\.json$", r"(?:\\.json)?", text))

    @property
    def media_type(self) -> str:
        """Media type of the content."""
        return MEDIA_TYPES.get(self.path.rpartition(".")[2], MEDIA_TYPES["json"])

    def parse_query(self, fields: Mapping[str, str]) -> msgspec.Struct | None:
        """Return the record of a query string, None if the route has none. Raises InputError for an invalid field."""
        if self.query is None:
            return None
        try:
            return msgspec.convert(dict(fields), self.query, strict=False)
        except msgspec.ValidationError as error:
            known = ", ".join(self.query.__struct_fields__) or "none"
            raise InputError(f"query string: {error} (parameters of this address: {known})") from None

    def content(self, catalogue: ReleaseCatalogue, value: Any, query: msgspec.Struct | None = None) -> bytes | None:
        """Return the content for a value of the parameter, None if the address does not exist."""
        values: tuple[Any, ...] = (value,) if self.parameter else ()
        if self.query is not None:
            values += (query if query is not None else msgspec.convert({}, self.query),)
        made = self.render(catalogue, *values)
        return msgspec.json.encode(made) if isinstance(made, msgspec.Struct) else made
