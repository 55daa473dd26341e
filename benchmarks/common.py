"""Option parsers, Markdown tables and data folders that several benchmarks use."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

__all__ = ["ROOT", "SHARED", "options_parser", "print_rows", "row_text", "seeds_parser", "table_head", "write_between"]

ROOT = Path(__file__).resolve().parents[1]
#: Real scenes, tables and models, in a folder next to the repository.
SHARED = ROOT.parent / "shared" / "data"


def options_parser(description: str | None) -> argparse.ArgumentParser:
    """Return a parser that prints a module's docstring with its line breaks."""
    return argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)


def seeds_parser(description: str | None, first: int, end: int) -> argparse.ArgumentParser:
    """Return an options parser with `--seeds FIRST END`."""
    parser = options_parser(description)
    parser.add_argument("--seeds", type=int, nargs=2, default=(first, end), metavar=("FIRST", "END"))
    return parser


def table_head(columns: Sequence[str]) -> str:
    """Return the first two lines of a Markdown table."""
    return f"{row_text(columns)}\n|{'---|' * len(columns)}"


def row_text(cells: Iterable[object]) -> str:
    """Return a row of a Markdown table; None is an empty cell."""
    return f"| {' | '.join('' if cell is None else str(cell) for cell in cells)} |"


def print_rows(columns: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Print a table, each row as soon as it is computed."""
    print(table_head(columns), flush=True)
    for row in rows:
        print(row_text(row), flush=True)


def write_between(page: Path, name: str, table: str) -> None:
    """Replace the text between the comments `<!-- NAME -->` and `<!-- /NAME -->` of a page by a table."""
    text = page.read_text(encoding="utf-8")
    head, rest = text.split(f"<!-- {name} -->\n", 1)
    _, tail = rest.split(f"<!-- /{name} -->", 1)
    page.write_text(f"{head}<!-- {name} -->\n\n{table}\n\n<!-- /{name} -->{tail}", encoding="utf-8")
