"""Tables and frame of the report's page: plain HTML, and one script of a few lines for its search box."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from metric_base.escaping import visible

__all__ = ["Linked", "paragraph", "plain", "search_table", "table", "whole_page"]

_STYLE = """
body { font: 16px/1.5 Georgia, serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
h1, h2 { font-weight: normal } h2 { margin-top: 2.5rem; border-bottom: 1px solid #ccc }
h3 { font-weight: normal; font-size: 1.1rem; margin: 1.5rem 0 0 } a { color: #0060a0 }
nav { font-size: 14px } nav a { margin-right: 1rem } div.table { overflow-x: auto }
table { border-collapse: collapse; font: 14px/1.4 system-ui, sans-serif; margin: .6rem 0 1rem }
td, th { padding: .15rem .9rem .15rem 0; text-align: left; vertical-align: top } th { border-bottom: 1px solid #888 }
tr:nth-child(odd) td { background: #f7f7f5 } td.n, th.n { text-align: right; white-space: nowrap }
p.note { color: #555 } svg { max-width: 100%; height: auto }
input[type=search] { font: inherit; width: 100%; max-width: 30rem; padding: .3rem .5rem; box-sizing: border-box }
div.search { max-height: 26rem; overflow: auto }
"""

#: Hides the rows that lack a word of what is typed. Without scripts the table is whole.
_SEARCH = """
for (const box of document.querySelectorAll("input[type=search]")) {
  const rows = [...document.getElementById(box.dataset.table).querySelectorAll("tr")].slice(1)
  const count = document.getElementById(box.dataset.table + "-count")
  box.addEventListener("input", () => {
    const words = box.value.toLowerCase().split(/\\s+/).filter(Boolean)
    let shown = 0
    for (const row of rows) {
      const text = row.dataset.words
      row.hidden = !words.every(word => text.includes(word))
      shown += !row.hidden
    }
    count.textContent = shown + " of " + rows.length
  })
}
"""

#: A cell that begins with a number is one: `70 (59%)`, `-39 %`.
_NUMBER = re.compile(r"^[-+]?[\d.,]+( ?%)?( \(\d+%\))?$")


@dataclass(frozen=True, slots=True)
class Linked:
    """A cell whose text leads to an address."""

    text: str
    url: str


def plain(text: object) -> str:
    """Text as HTML: no markup, and no characters that hide or turn round what stands beside them."""
    return escape(visible(str(text)))


def whole_page(title: str, note: str, sections: Iterable[tuple[str, str]]) -> str:
    """The page: a title, a note below it, sections of HTML with their titles and links to them."""
    parts = list(sections)
    links = "".join(f'<a href="#s{n}">{plain(name)}</a> ' for n, (name, _) in enumerate(parts))
    body = "\n".join(f"<h2 id=s{n}>{plain(name)}</h2>\n{content}" for n, (name, content) in enumerate(parts))
    return (
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f"<title>{plain(title)}</title>\n<style>{_STYLE}</style>\n"
        f"<h1>{plain(title)}</h1>\n<p class=note>{plain(note)}</p>\n<nav>{links}</nav>\n{body}\n"
        f"<script>{_SEARCH}</script>\n</html>\n"
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


def search_table(name: str, label: str, head: Sequence[str], rows: Sequence[tuple[str, Sequence[object]]]) -> str:
    """A table with a box above it that leaves the rows whose words hold all that is typed.

    Parameters
    ----------
    name : id of the table in the page.
    label : what the box is for.
    head : titles of the columns.
    rows : words to search in, and cells, of each row.
    """
    numeric = [bool(rows) and all(_NUMBER.match(_text(cells[n])) for _, cells in rows) for n in range(len(head))]
    lines = [_line(head, "th", numeric), *(_line(cells, "td", numeric, words) for words, cells in rows)]
    return (
        f'<p><input type=search data-table={name} aria-label="{plain(label)}" placeholder="{plain(label)}"> '
        f"<span id={name}-count>{len(rows)}</span></p>\n"
        f"<div class=search><table id={name}>\n" + "\n".join(lines) + "\n</table></div>\n"
    )


def _line(cells: Iterable[object], tag: str, numeric: Sequence[bool], words: str | None = None) -> str:
    marks = (" class=n" if number else "" for number in numeric)
    start = "<tr>" if words is None else f'<tr data-words="{plain(words.lower())}">'
    return start + "".join(f"<{tag}{mark}>{_cell(c)}</{tag}>" for c, mark in zip(cells, marks, strict=True)) + "</tr>"


def _cell(cell: object) -> str:
    if isinstance(cell, Linked) and cell.url.startswith("https://"):
        return f'<a href="{plain(cell.url)}">{plain(cell.text)}</a>'
    return plain(_text(cell))


def _text(cell: object) -> str:
    if isinstance(cell, Linked):
        return str(cell.text)
    return f"{cell:,}" if isinstance(cell, int) else str(cell)
