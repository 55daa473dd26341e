"""Tables and frame of the report's page: plain HTML without scripts."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from metric_base.escaping import visible

__all__ = ["Linked", "paragraph", "plain", "table", "whole_page"]

_STYLE = """
body { font: 16px/1.5 Georgia, serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
h1, h2 { font-weight: normal } h2 { margin-top: 2.5rem; border-bottom: 1px solid #ccc }
h3 { font-weight: normal; font-size: 1.1rem; margin: 1.5rem 0 0 } a { color: #0060a0 }
nav { font-size: 14px } nav a { margin-right: 1rem } div.table { overflow-x: auto }
table { border-collapse: collapse; font: 14px/1.4 system-ui, sans-serif; margin: .6rem 0 1rem }
td, th { padding: .15rem .9rem .15rem 0; text-align: left; vertical-align: top } th { border-bottom: 1px solid #888 }
tr:nth-child(odd) td { background: #f7f7f5 } td.n, th.n { text-align: right; white-space: nowrap }
p.note { color: #555 } svg { max-width: 100%; height: auto }
"""

#: A cell that begins with a number is one: `70 (59%)`, `-39 %`.
_NUMBER = re.compile(r"^[-+]?[\d.,]+( ?%)?( \(\d+%\))?$")


@dataclass(frozen=True, slots=True)
class Linked:
    """A cell whose text leads to an address."""

    text: str
    url: str


def plain(text: str) -> str:
    """Text as HTML: no markup, and no characters that hide or turn round what stands beside them."""
    return escape(visible(text))


def whole_page(title: str, note: str, sections: Iterable[tuple[str, str]]) -> str:
    """The page: a title, a note below it, sections of HTML with their titles and links to them."""
    parts = list(sections)
    links = "".join(f'<a href="#s{n}">{plain(name)}</a> ' for n, (name, _) in enumerate(parts))
    body = "\n".join(f"<h2 id=s{n}>{plain(name)}</h2>\n{content}" for n, (name, content) in enumerate(parts))
    return (
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f"<title>{plain(title)}</title>\n<style>{_STYLE}</style>\n"
        f"<h1>{plain(title)}</h1>\n<p class=note>{plain(note)}</p>\n<nav>{links}</nav>\n{body}\n</html>\n"
    )


def paragraph(text: str, note: bool = False) -> str:
    """A paragraph of plain text."""
    return f"<p{' class=note' if note else ''}>{plain(text)}</p>\n"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table; a column stands to the right where all of its cells are numbers."""
    cells = [list(row) for row in rows]
    numeric = [bool(cells) and all(_NUMBER.match(_text(row[n])) for row in cells) for n in range(len(head))]
    lines = [_line(head, "th", numeric), *(_line(row, "td", numeric) for row in cells)]
    return "<div class=table><table>\n" + "\n".join(lines) + "\n</table></div>\n"


def _line(cells: Iterable[object], tag: str, numeric: Sequence[bool]) -> str:
    marks = (" class=n" if number else "" for number in numeric)
    return "<tr>" + "".join(f"<{tag}{mark}>{_cell(c)}</{tag}>" for c, mark in zip(cells, marks, strict=True)) + "</tr>"


def _cell(cell: object) -> str:
    if isinstance(cell, Linked) and cell.url.startswith("https://"):
        return f'<a href="{plain(cell.url)}">{plain(cell.text)}</a>'
    return plain(_text(cell))


def _text(cell: object) -> str:
    if isinstance(cell, Linked):
        return cell.text
    return f"{cell:,}" if isinstance(cell, int) else str(cell)
