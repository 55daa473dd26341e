"""What every command shares: exit statuses, one line for an error of the input, JSON and tables on standard output."""

from __future__ import annotations

import argparse
import codecs
import io
import json
import os
import re
import shutil
import sys
import textwrap
import traceback
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import suppress
from contextvars import copy_context
from typing import Any, NamedTuple, NoReturn, TextIO, TypeVar

from metric_base.errors import InputError
from metric_base.escaping import visible, visible_json
from metric_base.files import WRITE_ERRORS
from metric_base.spelling import advice, near_spellings
from metric_cli.arguments import check_paths
from metric_cli.errors import missing_extra
from metric_cli.signals import INTERRUPTED, Terminated, orderly_termination

__all__ = [
    "DEBUG_VARIABLE",
    "Cell",
    "OneLineParser",
    "exit_status",
    "output_width",
    "print_json",
    "print_table",
    "statuses_text",
    "style_text",
    "table_text",
    "version",
    "warn",
]

Item = TypeVar("Item")

#: Set to see the traceback of an internal error.
DEBUG_VARIABLE = "METRIC_TREE_DEBUG"

#: Columns of a table that no terminal bounds: room for the longest row on one line.
PIPE_WIDTH = 100_000

#: Spaces between two columns of a table.
GAP = 3

#: Columns of the paragraphs below the options of a help.
HELP_WIDTH = 120

#: What a path should have been where the system refuses it.
_PATH_ERRORS: dict[type[OSError], str] = {
    FileNotFoundError: "an existing file or folder; found none",
    IsADirectoryError: "a file; found a folder",
    NotADirectoryError: "a folder; found a file",
    FileExistsError: "a folder, or nothing yet; found a file",
    PermissionError: "leave to read or write it; found none",
}

#: Select Graphic Rendition of ECMA-48.
_STYLES = {"bold": 1, "dim": 2, "red": 31, "green": 32}

#: Exit statuses. UNUSABLE: the run went well and its answer is no, such as an unresolved scale or a wrong model.
DONE, INTERNAL_ERROR, INPUT_ERROR, UNUSABLE, TERMINATED = 0, 1, 2, 3, 143


#: A replacement for each of our signs in an encoding that lacks it; anything else is written as an escape.
PLAIN = {"×": "x", "±": "+-", "–": "-", "−": "-", "…": "...", "→": "->", "≤": "<=", "≥": ">=", "°": " deg", "─": "-"}
_HANDLER = "metric-base-plain"


class OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line, with the option that was probably meant.

    A value may begin with a minus and a digit, such as the list `-0.5,0.2`, which older versions of argparse take for
    an option.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # as of Python 3.14; before, whole numbers alone

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """The options; an output that would replace an input or a file of others is an error."""
        options = super().parse_args(args, namespace)
        check_paths(self, options)
        return options

    def error(self, message: str) -> NoReturn:
        """Raise what is wrong as an error of the input."""
        unknown = re.match(r"unrecognized arguments: (.*)", message)
        if unknown is None:
            raise InputError(f"arguments: {message} (--help lists them)")
        word = next((word for word in unknown[1].split() if word.startswith("-")), unknown[1].strip())
        near = near_spellings(word.partition("=")[0], self._option_string_actions, n=1)
        raise InputError(f"arguments: no option is called {word}{advice(near) or '; --help lists them'}")


def exit_status(program: str, run: Callable[[], int]) -> int:
    """Run a command: 2 with one line for an error of the input, 1 with one line for an internal error.

    Ctrl-C and a request to terminate end it with one line and status 130 or 143, after its temporary files are
    removed. A closed standard output is no error.
    """
    make_streams_forgiving()
    with orderly_termination():
        try:
            status = copy_context().run(run)  # what one run reads and may replace is forgotten after it
            sys.stdout.flush()
        except BrokenPipeError:  # the reader of a pipe left; what it took is all it wanted
            status = DONE
        except KeyboardInterrupt:
            status = _report(program, "interrupted", INTERRUPTED)
        except Terminated:
            status = _report(program, "terminated", TERMINATED)
        except Exception as error:  # noqa: BLE001 - the last door: what is not the input's error is the program's
            status = _error_status(program, error)
    flush_or_silence(sys.stdout)
    return status


def statuses_text(done: str = "", input_error: str = "", unusable: str = "") -> str:
    """The end of a program's help: what its exit statuses say, in lines of its width."""
    parts = [f"{DONE} done{done}", f"{INPUT_ERROR} the input is invalid (one line says where){input_error}"]
    parts += [f"{UNUSABLE} {unusable}"] if unusable else []
    return textwrap.fill(f"Exit status: {'; '.join(parts)}; {INTERNAL_ERROR} an internal error.", HELP_WIDTH) + "\n"


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
    """Whether each sign of a text takes one column, as far as is known without a table of all signs."""
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


def version() -> str:
    """The version of the installed distribution."""
    from importlib import metadata  # with it comes `email`

    try:
        return metadata.version("metric-tree")
    except metadata.PackageNotFoundError:
        return "0+source"


def _path_error(error: OSError) -> str:
    expected = next(text for kind, text in _PATH_ERRORS.items() if isinstance(error, kind))
    return f"{error.filename}: expected {expected}" if error.filename is not None else str(error)


def _error_status(program: str, error: Exception) -> int:
    message = _input_error(error)
    if message is not None:
        return _report(program, message, INPUT_ERROR)
    if os.environ.get(DEBUG_VARIABLE):
        traceback.print_exc()
    return _report(program, f"internal error: {type(error).__name__}: {error}", INTERNAL_ERROR)


def _input_error(error: Exception) -> str | None:
    """The line about an error that the user can mend; None for an internal error."""
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, OSError) and isinstance(error, tuple(_PATH_ERRORS)):
        return _path_error(error)
    if isinstance(error, OSError) and error.errno in WRITE_ERRORS:
        return f"{error.filename or 'output'}: {error.strerror}"
    if isinstance(error, ModuleNotFoundError) and (extra := missing_extra(error.name)) is not None:
        return f"needs metric-tree[{extra}]: pip install 'metric-tree[{extra}]'"
    return None


def _report(program: str, message: str, status: int) -> int:
    with suppress(OSError):  # nobody reads it
        sys.stderr.write(f"{program}: {visible(' '.join(message.split()))}\n")
    return status


def _is_number(cell: str) -> bool:
    digits = cell.translate(str.maketrans("", "", ",%+- ")).replace(".", "", 1)
    return cell in {"–", ""} or digits.isdigit()


def make_streams_forgiving() -> None:
    """Make standard output and error take every character; a stream that is closed becomes silent."""
    codecs.register_error(_HANDLER, _plain)
    # a stream is None where the program was started with it closed
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def flush_or_silence(stream: TextIO) -> None:
    """Write what the stream holds; where that fails, drop it, so that the interpreter's last flush is no error."""
    try:
        stream.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Python's error handler: plain characters for signs of ours, escapes for the rest."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    plain = (PLAIN.get(sign) or sign.encode("ascii", "backslashreplace").decode("ascii") for sign in text)
    return "".join(plain), error.end
