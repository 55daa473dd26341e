"""What several benchmarks share: options, tables in Markdown, synthetic rooms, where the data lie."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene

__all__ = ["ROOT", "SHARED", "options_parser", "print_rows", "rooms", "row_text", "table_head", "write_between"]

ROOT = Path(__file__).resolve().parents[1]
#: Real scenes, tables and models beside the repository.
SHARED = ROOT.parent / "shared" / "data"


def options_parser(description: str | None) -> argparse.ArgumentParser:
    """A parser that shows a module's docstring as it is written."""
    return argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)


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


def rooms(first: int, end: int, knobs: Knobs) -> Iterator[tuple[str, SyntheticScene]]:
    """The name and the scene of a furnished room of each kind and seed."""
    for seed in range(first, end):
        for kind in KINDS:
            yield f"{kind} {seed}", quick_scene(furnished_room(kind, seed, knobs), knobs, seed=seed)


def write_between(page: Path, name: str, table: str) -> None:
    """Put a table between the comments `<!-- NAME -->` and `<!-- /NAME -->` of a page."""
    text = page.read_text(encoding="utf-8")
    head, rest = text.split(f"<!-- {name} -->\n", 1)
    _, tail = rest.split(f"<!-- /{name} -->", 1)
    page.write_text(f"{head}<!-- {name} -->\n\n{table}\n\n<!-- /{name} -->{tail}", encoding="utf-8")
