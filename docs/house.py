"""Draws the packages and their rooms: `docs/pictures/architecture.svg`, written by `make reference`.

python docs/house.py --lines    # files, lines, and what the lines hold, by package
"""

from __future__ import annotations

import ast
import re
import sys
import textwrap
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.project.test_imports import PACKAGES, ROOMS  # noqa: E402

PICTURE = ROOT / "docs" / "pictures" / "architecture.svg"
WIDTH, MARGIN, LINE, CHIP, GAP = 960, 20, 19, 26, 26
#: Width of a letter of a chip's 13 px text, and letters of a purpose on one line.
LETTER, PURPOSE = 7.4, 118


def drawing() -> str:
    """The picture: the last of the flow on top; a package imports from those below it, a room from those before it."""
    cards, y = [], float(MARGIN)
    for package in reversed(PACKAGES):
        card, height = _card(package, y)
        cards.append(card)
        y += height + GAP
        if package != PACKAGES[0]:
            cards.append(_arrow(y - GAP, y))
    total = y - GAP + MARGIN
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {total:.0f}" role="img" '
        'font-family="sans-serif">'
        "<title>The packages and their rooms, the last of the flow on top</title>"
        f'<rect width="{WIDTH}" height="{total:.0f}" fill="#fff"/>{"".join(cards)}</svg>\n'
    )


def _card(package: str, top: float) -> tuple[str, float]:
    lines = textwrap.wrap(_purpose(package), PURPOSE)
    chips, y = _chips([room for room in ROOMS if room.startswith(f"{package}.")], top + 32 + LINE * len(lines))
    height = y - top + 8
    text = "".join(
        f'<text x="{MARGIN + 14}" y="{top + 44 + LINE * n}" font-size="14" fill="#444">{escape(line)}</text>'
        for n, line in enumerate(lines)
    )
    name = f'<text x="{MARGIN + 14}" y="{top + 24}" font-size="17" font-weight="bold" fill="#123">{package}</text>'
    frame = (
        f'<rect x="{MARGIN}" y="{top}" width="{WIDTH - 2 * MARGIN}" height="{height}" rx="8" fill="#f3f6fa" '
        'stroke="#8aa0b8"/>'
    )
    return frame + name + text + chips, height


def _chips(rooms: list[str], top: float) -> tuple[str, float]:
    """The rooms of a package in their order, in rows; with the y below the last row."""
    parts, x, y = [], MARGIN + 14.0, top
    for room in rooms:
        name = room.partition(".")[2]
        width = LETTER * len(name) + 18
        if x + width > WIDTH - MARGIN - 14:
            x, y = MARGIN + 14.0, y + CHIP + 6
        parts.append(
            f'<g><title>{escape(_purpose(room))}</title><rect x="{x:.1f}" y="{y}" width="{width:.1f}" '
            f'height="{CHIP}" rx="5" fill="#fff" stroke="#b8c4d0"/>'
            f'<text x="{x + width / 2:.1f}" y="{y + 17.5}" font-size="13" text-anchor="middle">{name}</text></g>'
        )
        x += width + 8
    return "".join(parts), y + (CHIP + 6 if rooms else 0)


def _arrow(top: float, bottom: float) -> str:
    x, tip = WIDTH / 2, bottom - 4
    return (
        f'<path d="M{x} {top + 3}V{tip - 6}" stroke="#567" stroke-width="2"/>'
        f'<path d="M{x - 6} {tip - 8}L{x} {tip}L{x + 6} {tip - 8}Z" fill="#567"/>'
        f'<text x="{x + 12}" y="{bottom - 8}" font-size="12" fill="#567">imports</text>'
    )


def _purpose(room: str) -> str:
    """The first paragraph of a room's docstring, without the marks of code."""
    text = (ROOT / room.replace(".", "/") / "__init__.py").read_text(encoding="utf-8")
    first = (ast.get_docstring(ast.parse(text)) or "").partition("\n\n")[0]
    return re.sub(r"\s+", " ", first.replace("`", ""))


def line_counts(package: str) -> tuple[int, int, int, int, int]:
    """Files of a package, their lines, and how many are code, docstrings, and comments or blank."""
    files = sorted((ROOT / package).rglob("*.py"))
    lines = docstrings = others = 0
    for file in files:
        text = file.read_text(encoding="utf-8")
        rows, documented = text.splitlines(), set[int]()
        for node in ast.walk(ast.parse(text)):
            body = getattr(node, "body", None)
            first = body[0] if isinstance(body, list) and body else None
            if isinstance(first, ast.Expr) and isinstance(getattr(first.value, "value", None), str):
                documented |= set(range(first.lineno, (first.end_lineno or first.lineno) + 1))
        lines, docstrings = lines + len(rows), docstrings + len(documented)
        others += sum(
            number not in documented and (not row.strip() or row.lstrip().startswith("#"))
            for number, row in enumerate(rows, 1)
        )
    return len(files), lines, lines - docstrings - others, docstrings, others


def lines_table() -> str:
    """The counts of every package and their sum, as a table of Markdown."""
    counts = {package: line_counts(package) for package in PACKAGES}
    counts["all"] = tuple(map(sum, zip(*counts.values(), strict=True)))  # type: ignore[assignment]
    head = "| package | files | lines | code | docstrings | comments, blank |\n|---|---:|---:|---:|---:|---:|"
    return "\n".join([head, *(f"| {name} | {' | '.join(f'{n:,}' for n in row)} |" for name, row in counts.items())])


if __name__ == "__main__":
    if "--lines" in sys.argv[1:]:
        sys.stdout.write(f"{lines_table()}\n")
    else:
        PICTURE.write_text(drawing(), encoding="utf-8")
