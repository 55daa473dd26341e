"""The Jinja2 environment of the pages: escaping, filters for lengths and addresses, cells of the report's tables."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from html import escape
from statistics import median
from typing import Any
from urllib.parse import urlsplit

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from explorer.catalogue import MEANINGS, ReleaseCatalogue
from explorer.charts.axis import length_text
from explorer.urls import page_of, slug
from metric_base.escaping import visible

#: A cell that is a number, with an optional percentage: `70 (59%)`, `-39 %`.
_NUMBER = re.compile(r"^[-+]?[\d.,]+( ?%)?( \(\d+%\))?$")

#: A number with a unit of length, which a line does not break.
_LENGTH = re.compile(r"(\d) (km|m|cm|mm)\b")


def page_bytes(catalogue: ReleaseCatalogue, template: str, root: str, title: str, **values: Any) -> bytes:
    """Return a page as UTF-8; `root` is the relative URL of the release folder (`../` or empty)."""
    tree, created = catalogue.tree, catalogue.tree.release.manifest["created"]
    text = environment().get_template(template).render(tree=tree, created=created, root=root, title=title, **values)
    return text.encode()


def web_address(text: Any) -> str:
    """Return the URL if it is a web address, otherwise an empty string: sources may state other schemes."""
    return text if isinstance(text, str) and urlsplit(text).scheme in {"http", "https"} else ""


def main_dimension(dims: Any) -> str:
    """Return the main dimension of a size: the height, otherwise the first."""
    return "height" if "height" in dims else next(iter(dims), "")


def plain_html(text: object) -> Markup:
    """Return text as HTML: no markup, and no characters that hide or reverse the text next to them."""
    return Markup(escape(visible(str(text))))


def cell_text(cell: object) -> str:
    """Return the text of a cell; integers have separators of thousands."""
    return f"{cell:,}" if isinstance(cell, int) else str(cell)


def cell_html(cell: object) -> Markup:
    """Return the content of a cell as HTML, which may be HTML already."""
    return cell if isinstance(cell, Markup) else plain_html(cell_text(cell))


def link_html(text: str, url: object) -> Markup:
    """Return text as HTML, a link if the URL is a web address."""
    address, shown = web_address(url), plain_html(text)
    return Markup('<a href="{}">{}</a>').format(plain_html(address), shown) if address else shown


def numeric_columns(rows: Sequence[Sequence[object]], n_columns: int) -> list[bool]:
    """Return for each column whether all of its cells are numbers, False without rows."""
    return [bool(rows) and all(_NUMBER.match(cell_text(row[n])) for row in rows) for n in range(n_columns)]


@cache
def environment() -> Environment:
    """Return the environment of all pages."""
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
        "plain": plain_html,
        "unbroken": lambda text: _LENGTH.sub("\\1\u00a0\\2", text),
        "typical_mm": lambda sizes: median([mm for mm in sizes if mm] or [1.0]),
        "licence": lambda text: "no licence stated" if text in (None, "", "none") else text,
        "cell": cell_html,
        "numeric_columns": numeric_columns,
        "main_dim": lambda sizes: (main_dimension(sizes), sizes[main_dimension(sizes)]),
    }
    return environment
