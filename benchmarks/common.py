"""What several benchmarks share: options, tables in Markdown, where the data lie."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

__all__ = ["ROOT", "SHARED", "options_parser", "print_rows", "row_text", "seeds_parser", "table_head", "write_between"]

ROOT = Path(__file__).resolve().parents[1]
#: Real scenes, tables and models beside the repository.
SHARED = ROOT.parent / "shared" / "data"


def options_parser(description: str | None) -> argparse.ArgumentParser:
    """A parser that shows a module's docstring as it is written."""
    return argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)


def seeds_parser(description: str | None, first: int, end: int) -> argparse.ArgumentParser:
    """The same with `--seeds FIRST END`."""
    parser = options_parser(description)
    parser.add_argument("--seeds", type=int, nargs=2, default=(first, end), metavar=("FIRST", "END"))
    return parser


def table_head(columns: Sequence[str]) -> str:
    """The first two lines of a table."""
    return f"{row_text(columns)}\n|{'---|' * len(columns)}"


def row_text(cells: Iterable[object]) -> str:
    """A line of a table; None is an empty cell."""
    return f"| {' | '.join('' if cell is None else str(cell) for cell in cells)} |"


def print_rows(columns: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Print a table, each row as soon as it is known."""
    print(table_head(columns), flush=True)
    for row in rows:
        print(row_text(row), flush=True)


def write_between(page: Path, name: str, table: str) -> None:
    """Put a table between the comments `<!-- NAME -->` and `<!-- /NAME -->` of a page."""
    text = page.read_text(encoding="utf-8")
    head, rest = text.split(f"<!-- {name} -->\n", 1)
    _, tail = rest.split(f"<!-- /{name} -->", 1)
    page.write_text(f"{head}<!-- {name} -->\n\n{table}\n\n<!-- /{name} -->{tail}", encoding="utf-8")
