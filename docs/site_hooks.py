"""What the documentation's site adds to the pages: a home from the README, mathematics as MathML, notebooks, links.

`mkdocs.yml` names it. Links that leave `docs/` lead to the repository, and are checked: a broken one ends the build.
"""

from __future__ import annotations

import html
import json
import re
import shutil
from pathlib import Path
from typing import Any

REPOSITORY = "https://github.com/metric-tree/metric-tree/blob/main/"
ROOT = Path(__file__).resolve().parents[1]
_LINK = re.compile(r"(?<!`)\]\((?!https?:|#|mailto:)([^)#\s]+)(#[^)\s]*)?\)")
_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\(?P<open>[(\[])(?P<text>.*?)\\[)\]]</(?P=tag)>', re.DOTALL
)
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def on_files(files: Any, config: Any) -> Any:
    """Add the README as the home page, its links turned to those of the site."""
    from mkdocs.structure.files import File

    text = (ROOT / "README.md").read_text(encoding="utf-8")
    files.append(File.generated(config, "index.md", content=repository_links(text, ROOT)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn links that leave the documentation; a tutorial names its notebook."""
    source = ROOT / "docs" / page.file.src_uri
    text = markdown if page.file.src_uri == "index.md" else repository_links(markdown, source.parent)
    if page.file.src_uri.startswith("tutorial/"):
        name = f"{Path(page.file.src_uri).stem}.ipynb"
        head, _, rest = text.partition("\n")
        text = f'{head}\n\n<a href="{name}" download>The same as a notebook</a>\n{rest}'
    return text


def on_page_content(content: str, **_: Any) -> str:
    """Formulas as MathML, which browsers draw without a script."""
    return _FORMULA.sub(_mathml, content)


def on_post_build(config: Any) -> None:
    """Write the notebooks of the tutorials and the font of formulas."""
    import ziamath

    font = Path(ziamath.__file__).with_name("fonts") / "STIXTwoMath-Regular.ttf"
    shutil.copyfile(font, Path(config["site_dir"]) / font.name)
    for page in sorted((ROOT / "docs" / "tutorial").glob("*.md")):
        record = notebook(page.read_text(encoding="utf-8"))
        target = Path(config["site_dir"]) / "tutorial" / f"{page.stem}.ipynb"
        target.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def repository_links(text: str, folder: Path) -> str:
    """The Markdown of a page in `folder` with links out of `docs/` as addresses of the repository.

    Raises
    ------
    FileNotFoundError
        A link leads to no file.
    """

    def turned(match: re.Match[str]) -> str:
        target = (folder / match[1]).resolve()
        if not target.exists():
            raise FileNotFoundError(f"{folder}: {match[1]}: expected a file or a folder")
        docs = ROOT / "docs"
        if target.is_relative_to(docs) and target.suffix != ".py":
            return match[0] if folder != ROOT else f"]({target.relative_to(docs).as_posix()}{match[2] or ''})"
        return f"]({REPOSITORY}{target.relative_to(ROOT).as_posix()}{match[2] or ''})"

    return _LINK.sub(turned, text)


def notebook(markdown: str) -> dict[str, Any]:
    """A page as a notebook (nbformat 4): text, Python as cells, commands as cells of the shell."""
    cells: list[dict[str, Any]] = []
    place = 0
    for match in _FENCE.finditer(markdown):
        _append_text(cells, markdown[place : match.start()])
        place = match.end()
        code = _cell_code(match[1], match[2])
        if code is None:
            _append_text(cells, match[0])
        else:
            cells.append({"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": code})
    _append_text(cells, markdown[place:])
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def _append_text(cells: list[dict[str, Any]], text: str) -> None:
    if text.strip():
        cells.append({"cell_type": "markdown", "metadata": {}, "source": text.strip()})


def _cell_code(language: str, text: str) -> str | None:
    """The code of a cell; None for a block that is only read."""
    if language == "python":
        return text.rstrip()
    if language == "console":
        return "\n".join("!" + line[2:] for line in text.splitlines() if line.startswith("$ "))
    return None


def _mathml(match: re.Match[str]) -> str:
    from latex2mathml.converter import convert

    return str(convert(html.unescape(match["text"]), display="inline" if match["open"] == "(" else "block"))
