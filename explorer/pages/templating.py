"""The Jinja2 environment of the pages: escaping, and filters for lengths and addresses."""

from __future__ import annotations

from functools import cache
from typing import Any
from urllib.parse import urlsplit

from jinja2 import Environment, PackageLoader, StrictUndefined

from explorer.catalogue import MEANINGS, ReleaseCatalogue
from explorer.charts.axis import length_text
from explorer.urls import page_of, slug


def page_bytes(catalogue: ReleaseCatalogue, template: str, root: str, title: str, **values: Any) -> bytes:
    """Return a page as UTF-8; `root` is the relative URL of the release folder (`../` or empty)."""
    tree, created = catalogue.tree, catalogue.tree.release.manifest["created"]
    text = _environment().get_template(template).render(tree=tree, created=created, root=root, title=title, **values)
    return text.encode()


def web_address(text: Any) -> str:
    """Return the URL if it is a web address, otherwise an empty string: sources may state other schemes."""
    return text if isinstance(text, str) and urlsplit(text).scheme in {"http", "https"} else ""


def main_dimension(dims: Any) -> str:
    """Return the main dimension of a size: the height, otherwise the first."""
    return "height" if "height" in dims else next(iter(dims), "")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("explorer.pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
    environment.globals["tiers"] = MEANINGS
    environment.globals["description"] = ""
    environment.filters |= {
        "length_text": length_text,
        "page": page_of,
        "slug": slug,
        "main_dim": lambda sizes: (main_dimension(sizes), sizes[main_dimension(sizes)]),
    }
    return environment
