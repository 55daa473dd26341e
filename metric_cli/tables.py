"""What every command shares: exit statuses, one line for an error of the input, JSON and tables on standard output."""

from __future__ import annotations

import io
import json
import shutil
import sys
from collections.abc import Collection, Iterable, Sequence
from typing import Any, NamedTuple, TypeVar

from metric_base.escaping import visible, visible_json

Item = TypeVar("Item")
#: Columns of a table that no terminal bounds: room for the longest row on one line.
PIPE_WIDTH = 100_000
#: Spaces between two columns of a table.
GAP = 3
#: Select Graphic Rendition of ECMA-48.
_STYLES = {"bold": 1, "dim": 2, "red": 31, "green": 32}
#: A replacement for each of our signs in an encoding that lacks it; anything else is written as an escape.
PLAIN = {"×": "x", "±": "+-", "–": "-", "−": "-", "…": "...", "→": "->", "≤": "<=", "≥": ">=", "°": " deg", "─": "-"}
_HANDLER = "metric-base-plain"


def warn(message: str, program: str | None = None) -> None:
    """One line on standard error about what the command does all the same."""
    head = "warning" if program is None else f"{program}: warning"
    sys.stderr.write(f"{head}: {visible(' '.join(message.split()))}\n")


def print_json(value: Any) -> None:
    """Print a value as JSON, indented for a person, exact for a machine."""
    sys.stdout.write(visible_json(json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False)) + "\n")


def print_table(columns: Sequence[str], rows: Iterable[Sequence[object]], title: str | None = None) -> None:
    """Print an aligned table (`table_text`) under its title, as wide as the terminal or as `COLUMNS` says.

    The title is a line of its own: as wide as it is, however narrow the table.
    """
    if title is not None:
        sys.stdout.write(f"{visible(title)}\n")
    sys.stdout.write(table_text(columns, rows, output_width(PIPE_WIDTH)))


class Cell(NamedTuple):
    """The text of a table's cell in a style of its own: `bold`, `dim`, `red`, `green`."""

    text: str
    style: str


def table_text(
    columns: Sequence[str], rows: Iterable[Sequence[object]], width: int, unbroken: Collection[str] = ()
) -> str:
    """An aligned table of at most `width` columns; a column of numbers is aligned to the right, None is a dash.

    A cell may be a `Cell`, whose style a terminal shows. Words wrap, but in the columns called `unbroken`,
    whose cells are shown as they are.
    """
    cells = [
        [cell if isinstance(cell, Cell) else Cell("–" if cell is None else str(cell), "") for cell in row]
        for row in rows
    ]
    cells = [[Cell(visible(cell.text), cell.style) for cell in row] for row in cells]
    numeric = [
        bool(cells) and column not in unbroken and all(_is_number(row[number].text) for row in cells)
        for number, column in enumerate(columns)
    ]
    if not sys.stdout.isatty():
        lines = [list(columns), *([cell.text for cell in row] for row in cells)]
        widths = [max(len(line[number]) for line in lines) for number in range(len(columns))]
        narrow = all(_is_one_wide(text) for line in lines for text in line)
        if narrow and sum(widths) + GAP * len(widths) <= width:
            return _plain_table(lines, widths, numeric)
    return _rich_table(columns, cells, numeric, width, unbroken)


def _is_one_wide(text: str) -> bool:
    """Return True if each sign of a text takes one column, as far as is known without a table of all signs."""
    return text.isprintable() and all(sign.isascii() or sign in PLAIN for sign in text)


def _plain_table(lines: Sequence[Sequence[str]], widths: Sequence[int], numeric: Sequence[bool]) -> str:
    """The table as rich writes one that needs no line broken, without its import: a tenth of a query's time.

    lines : the cells of the head, then of the rows.
    """
    texts = [
        (" " * GAP).join(
            text.rstrip().rjust(width) if right else text.rstrip().ljust(width)
            for text, width, right in zip(line, widths, numeric, strict=True)
        )
        for line in lines
    ]
    head, *rows = (f" {text}".rstrip() for text in texts)
    return "\n".join(["", head, f" {'─' * len(texts[0])}", *rows, "", ""])


def _rich_table(
    columns: Sequence[str],
    cells: Sequence[Sequence[Cell]],
    numeric: Sequence[bool],
    width: int,
    unbroken: Collection[str],
) -> str:
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column, right in zip(columns, numeric, strict=True):
        table.add_column(column, justify="right" if right else "left", overflow="fold", no_wrap=column in unbroken)
    for row in cells:
        table.add_row(*(Text(cell.text, cell.style) for cell in row))
    # Rendered first and written by us: rich would turn a closed pipe into a failure.
    terminal = sys.stdout.isatty()
    console = Console(file=io.StringIO(), width=width, force_terminal=terminal, highlight=False)
    with console.capture() as captured:
        console.print(table)
    return "\n".join(line.rstrip() for line in captured.get().splitlines()) + "\n"


def style_text(text: str, style: str) -> str:
    """The text, in its style where standard output is a terminal."""
    return f"\x1b[{_STYLES[style]}m{text}\x1b[0m" if sys.stdout.isatty() else text


def output_width(piped: int) -> int:
    """Columns of standard output: `COLUMNS` where it is set, else the terminal's, else `piped`."""
    fallback = 80 if sys.stdout.isatty() else piped
    return shutil.get_terminal_size((fallback, 24)).columns


def _is_number(cell: str) -> bool:
    digits = cell.translate(str.maketrans("", "", ",%+- ")).replace(".", "", 1)
    return cell in {"–", ""} or digits.isdigit()


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Python's error handler: plain characters for signs of ours, escapes for the rest."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    plain = (PLAIN.get(sign) or sign.encode("ascii", "backslashreplace").decode("ascii") for sign in text)
    return "".join(plain), error.end
