"""JSON, tables and styled text on standard output, and warnings on standard error."""

from __future__ import annotations

import io
import json
import math
import shutil
import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any, NamedTuple, TypeVar

from metric_base.escaping import visible, visible_json

Item = TypeVar("Item")
#: Width of a table in columns if standard output is not a terminal: no row is wrapped.
PIPE_WIDTH = 100_000
#: Number of spaces between two columns of a table.
GAP = 3
#: Units of tables of sizes: millimetres, significant digits of the smallest size, and the maximum number of decimals.
SIZE_UNITS = {"mm": (1.0, 2, 1), "cm": (10.0, 3, 2), "in": (25.4, 3, 2)}
#: Codes of the styles (Select Graphic Rendition of ECMA-48).
_STYLES = {"bold": 1, "dim": 2, "red": 31, "green": 32}
#: Replacements of characters that the encoding of a stream lacks; other characters are written as escapes.
PLAIN = {"×": "x", "±": "+-", "–": "-", "−": "-", "…": "...", "→": "->", "≤": "<=", "≥": ">=", "°": " deg", "─": "-"}
_HANDLER = "metric-base-plain"


def warn(message: str, program: str | None = None) -> None:
    """Print a warning in one line on standard error."""
    head = "warning" if program is None else f"{program}: warning"
    sys.stderr.write(f"{head}: {visible(' '.join(message.split()))}\n")


def print_json(value: Any) -> None:
    """Print a value as indented JSON."""
    sys.stdout.write(visible_json(json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False)) + "\n")


def print_table(columns: Sequence[str], rows: Iterable[Sequence[object]], title: str | None = None) -> None:
    """Print a title, which is not wrapped, and an aligned table of at most the width of the terminal or `COLUMNS`."""
    if title is not None:
        sys.stdout.write(f"{visible(title)}\n")
    sys.stdout.write(table_text(columns, rows, output_width(PIPE_WIDTH)))


def print_result(
    as_json: bool, record: Any, columns: Sequence[str], rows: Iterable[Sequence[object]], title: str | None = None
) -> None:
    """Print a result as JSON, or as a table with a title."""
    if as_json:
        print_json(record)
    else:
        print_table(columns, rows, title)


def print_line(as_json: bool, record: Any, line: object) -> None:
    """Print a result as JSON, or as a line of text."""
    if as_json:
        print_json(record)
    else:
        sys.stdout.write(f"{line}\n")


def size_format(sizes_mm: Iterable[float | None], unit: str) -> Callable[[float | None], str | None]:
    """Return the function that writes the sizes of a table in one unit with the same number of decimals.

    The smallest size has the number of significant digits of `SIZE_UNITS`, unless that needs more decimals.

    >>> write = size_format([91.4, 1240], "in")
    >>> write(91.4), write(1240), write(None)
    ('3.60', '48.82', None)
    """
    factor, digits, max_decimals = SIZE_UNITS[unit]
    smallest = min((mm for mm in sizes_mm if mm), default=factor) / factor
    decimals = min(max(digits - 1 - math.floor(math.log10(smallest)), 0), max_decimals)
    return lambda mm: None if mm is None else f"{mm / factor:.{decimals}f}"


class Cell(NamedTuple):
    """Text of a cell and its style: `bold`, `dim`, `red` or `green`."""

    text: str
    style: str


def table_text(
    columns: Sequence[str], rows: Iterable[Sequence[object]], width: int, unbroken: Collection[str] = ()
) -> str:
    """Return a table of at most `width` columns of text.

    Columns of numbers are aligned to the right. None is a dash. The style of a `Cell` is shown on a terminal. Cells are
    wrapped, except in the columns named in `unbroken`.
    """

    def cell_of(value: object) -> Cell:
        text, style = value if isinstance(value, Cell) else ("–" if value is None else str(value), "")
        return Cell(visible(text), style)

    cells = [[cell_of(value) for value in row] for row in rows]
    numeric = [
        bool(cells) and column not in unbroken and all(is_number(row[index].text) for row in cells)
        for index, column in enumerate(columns)
    ]
    if not sys.stdout.isatty():
        # As rich writes a table without wrapped lines, but without its import, which takes a tenth of a query's time
        lines = [list(columns), *([cell.text for cell in row] for row in cells)]
        widths = [max(len(line[index]) for line in lines) for index in range(len(columns))]
        is_narrow = all(
            text.isprintable() and all(c.isascii() or c in PLAIN for c in text) for row in lines for text in row
        )
        if is_narrow and sum(widths) + GAP * len(widths) <= width:
            texts = [
                (" " * GAP).join(
                    text.rstrip().rjust(column_width) if right else text.rstrip().ljust(column_width)
                    for text, column_width, right in zip(line, widths, numeric, strict=True)
                )
                for line in lines
            ]
            head, *others = (f" {text}".rstrip() for text in texts)
            return "\n".join(["", head, f" {'─' * len(texts[0])}", *others, "", ""])
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column, right in zip(columns, numeric, strict=True):
        table.add_column(column, justify="right" if right else "left", overflow="fold", no_wrap=column in unbroken)
    for row in cells:
        table.add_row(*(Text(cell.text, cell.style) for cell in row))
    # captured, because rich would turn a closed pipe into a failure
    console = Console(file=io.StringIO(), width=width, force_terminal=sys.stdout.isatty(), highlight=False)
    with console.capture() as captured:
        console.print(table)
    return "\n".join(line.rstrip() for line in captured.get().splitlines()) + "\n"


def style_text(text: str, style: str) -> str:
    """Return the text with its style if standard output is a terminal."""
    return f"\x1b[{_STYLES[style]}m{text}\x1b[0m" if sys.stdout.isatty() else text


def output_width(piped: int) -> int:
    """Return the width of standard output in columns: `COLUMNS`, else that of the terminal, else `piped`."""
    fallback = 80 if sys.stdout.isatty() else piped
    return shutil.get_terminal_size((fallback, 24)).columns


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a sign, separators and a percent sign at most; a dash is one, too."""
    digits = cell.translate(str.maketrans("", "", ",%+- ")).replace(".", "", 1)
    return cell in {"–", ""} or digits.isdigit()


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Handle an encoding error: replace the characters in `PLAIN`, and escape others."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    plain = (PLAIN.get(sign) or sign.encode("ascii", "backslashreplace").decode("ascii") for sign in text)
    return "".join(plain), error.end
