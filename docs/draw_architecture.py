"""Draw the packages and their imports: `docs/images/architecture.svg`, written by `make reference`.

The arrows are the imports that the modules have, without those that follow from others (transitive reduction).
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

from tests.project.test_imports import LAYERS, PACKAGES, imported_modules  # noqa: E402

IMAGE = ROOT / "docs" / "images" / "architecture.svg"
#: Sizes in pixels: the drawing, its margin, a line of text, the label of a subpackage, the gap between rows of cards.
WIDTH, MARGIN, LINE, CHIP, GAP = 960, 20, 19, 26, 46
#: Width of a letter of a subpackage's name in pixels, and of a letter of a purpose.
LETTER, PURPOSE_LETTER = 7.4, 7.0


def package_imports() -> dict[str, set[str]]:
    """Return the packages that each package imports, without those that its imports import already."""
    imports: dict[str, set[str]] = {}
    for package in PACKAGES:
        files = (ROOT / package).rglob("*.py")
        names = {name.partition(".")[0] for file in files for name in imported_modules(file.read_text("utf-8"))}
        imports[package] = (names & set(PACKAGES)) - {package}
    reached: dict[str, set[str]] = {}
    for package in PACKAGES:  # lower packages first
        reached[package] = imports[package].union(*(reached.get(below, set()) for below in imports[package]))
    return {
        package: {name for name in names if not any(name in reached[other] for other in names - {name})}
        for package, names in imports.items()
    }


def drawing() -> str:
    """Return the drawing as SVG: a package is below all packages that import it."""
    imports = package_imports()
    row_of: dict[str, int] = {}
    for package in reversed(PACKAGES):
        row_of[package] = 1 + max((row_of[user] for user in row_of if package in imports[user]), default=-1)
    rows = [[package for package in PACKAGES if row_of[package] == row] for row in range(max(row_of.values()) + 1)]
    places: dict[str, tuple[float, float, float, float]] = {}
    parts, top = [], float(MARGIN)
    for row in rows:
        width = (WIDTH - 2 * MARGIN - GAP * (len(row) - 1)) / len(row)
        cards = [_card(package, MARGIN + column * (width + GAP), top, width) for column, package in enumerate(row)]
        for column, package in enumerate(row):
            places[package] = (MARGIN + column * (width + GAP), top, width, cards[column][1])
        parts += [card for card, _ in cards]
        top += max(height for _, height in cards) + GAP
    arrows = "".join(
        _arrow(places[package], places[below]) for package in PACKAGES for below in sorted(imports[package])
    )
    height = top - GAP + MARGIN
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:.0f}" role="img" '
        'font-family="sans-serif">'
        "<title>The packages and their imports: a package imports those below it to which arrows lead</title>"
        f'<rect width="{WIDTH}" height="{height:.0f}" fill="#fff"/>{arrows}{"".join(parts)}</svg>\n'
    )


def _card(package: str, left: float, top: float, width: float) -> tuple[str, float]:
    """Return the card of a package as SVG, and its height."""
    lines = textwrap.wrap(_purpose(package), int((width - 28) / PURPOSE_LETTER))
    parts = [
        f'<text x="{left + 14:.1f}" y="{top + 24}" font-size="17" font-weight="bold" fill="#123">{package}</text>',
        *(
            f'<text x="{left + 14:.1f}" y="{top + 44 + LINE * number}" font-size="14" fill="#444">{escape(line)}</text>'
            for number, line in enumerate(lines)
        ),
    ]
    named = [name for name in LAYERS.split() if name.startswith(f"{package}.")]
    subpackages = [name for name in named if (ROOT / name.replace(".", "/")).is_dir()]
    x, y = left + 14.0, top + 38 + LINE * len(lines)
    for name in subpackages:
        label = name.partition(".")[2]
        chip = LETTER * len(label) + 18
        if x + chip > left + width - 14:
            x, y = left + 14.0, y + CHIP + 6
        parts.append(
            f'<g><title>{escape(_purpose(name))}</title><rect x="{x:.1f}" y="{y}" width="{chip:.1f}" '
            f'height="{CHIP}" rx="5" fill="#fff" stroke="#b8c4d0"/>'
            f'<text x="{x + chip / 2:.1f}" y="{y + 17.5}" font-size="13" text-anchor="middle">{label}</text></g>'
        )
        x += chip + 8
    height = y + (CHIP + 14 if subpackages else 4) - top
    frame = (
        f'<rect x="{left:.1f}" y="{top}" width="{width:.1f}" height="{height}" rx="8" fill="#f3f6fa" stroke="#8aa0b8"/>'
    )
    return frame + "".join(parts), height


def _arrow(upper: tuple[float, float, float, float], lower: tuple[float, float, float, float]) -> str:
    """Return an arrow from a package to one that it imports."""
    x0, y0 = upper[0] + upper[2] / 2, upper[1] + upper[3]
    x1, y1 = lower[0] + lower[2] / 2, lower[1] - 3
    return (
        f'<path d="M{x0:.1f} {y0}C{x0:.1f} {y0 + 30} {x1:.1f} {y1 - 34} {x1:.1f} {y1 - 8}" fill="none" stroke="#567" '
        f'stroke-width="2"/><path d="M{x1 - 6:.1f} {y1 - 9}L{x1:.1f} {y1}L{x1 + 6:.1f} {y1 - 9}Z" fill="#567"/>'
    )


def _purpose(package: str) -> str:
    """Return the first paragraph of a package's docstring, without the marks of code."""
    text = (ROOT / package.replace(".", "/") / "__init__.py").read_text(encoding="utf-8")
    first = (ast.get_docstring(ast.parse(text)) or "").partition("\n\n")[0]
    return re.sub(r"\s+", " ", first.replace("`", ""))


if __name__ == "__main__":
    IMAGE.write_text(drawing(), encoding="utf-8")
