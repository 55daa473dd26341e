"""Exceptions to exit statuses and one-line messages, extras of missing modules, and streams that never fail."""

from __future__ import annotations

import codecs
import io
import os
import sys
import textwrap
import traceback
from collections.abc import Callable
from contextlib import suppress
from contextvars import copy_context
from pathlib import Path
from typing import TextIO

from metric_base.errors import InputError
from metric_base.escaping import visible
from metric_base.files import WRITE_ERRORS
from metric_base.remote import with_remote_files
from metric_base.text_tables import named_texts
from metric_cli.parser import HELP_WIDTH
from metric_cli.programs import INTERRUPTED, Terminated, orderly_termination
from metric_cli.tables import _HANDLER, _plain

#: Modules of each extra of `pyproject.toml`.
MODULES_BY_EXTRA = {
    extra: modules.split() for extra, modules in named_texts(Path(__file__).with_name("extras.txt")).items()
}
#: Environment variable that shows the traceback of an internal error.
DEBUG_ENV = "METRIC_TREE_DEBUG"
#: Expected and found state of a path, by the error of the system.
_PATH_ERRORS: dict[type[OSError], str] = {
    FileNotFoundError: "an existing file or folder; found none",
    IsADirectoryError: "a file; found a folder",
    NotADirectoryError: "a folder; found a file",
    FileExistsError: "a folder, or nothing yet; found a file",
    PermissionError: "leave to read or write it; found none",
}
#: Exit statuses. EXIT_NEGATIVE_RESULT: the run succeeded with a negative result, such as an unresolved scale.
EXIT_OK, INTERNAL_ERROR, INPUT_ERROR, EXIT_NEGATIVE_RESULT, TERMINATED = 0, 1, 2, 3, 143


def missing_extra(module: str | None) -> str | None:
    """Return the extra that has a module, None if no extra has it.

    >>> missing_extra("scrapy.http")
    'crawl'
    """
    root = (module or "").partition(".")[0]
    return next((extra for extra, modules in MODULES_BY_EXTRA.items() if root in modules), None)


def exit_status(program: str, run: Callable[[], int]) -> int:
    """Run a command and return its status: 2 with one line for an invalid input, 1 with one line for an internal error.

    Ctrl-C and SIGTERM end it with one line and status 130 or 143, after the temporary files are removed. A closed
    standard output is not an error.
    """
    configure_streams()
    with orderly_termination():
        try:
            status = copy_context().run(with_remote_files, run)  # the rules of outputs end with the run
            sys.stdout.flush()
        except BrokenPipeError:  # the reader of the pipe needs no more output
            status = EXIT_OK
        except KeyboardInterrupt:
            status = _report(program, "interrupted", INTERRUPTED)
        except Terminated:
            status = _report(program, "terminated", TERMINATED)
        except Exception as error:  # noqa: BLE001 - any other error is an internal one
            message, status = input_error_message(error), INPUT_ERROR
            if message is None:
                message, status = f"internal error: {type(error).__name__}: {error}", INTERNAL_ERROR
                if os.environ.get(DEBUG_ENV):
                    traceback.print_exc()
            _report(program, message, status)
    flush_or_discard(sys.stdout)
    return status


def exit_status_help(done: str = "", input_error: str = "", unusable: str = "") -> str:
    """Return the description of the exit statuses for the end of a help text."""
    parts = [f"{EXIT_OK} done{done}", f"{INPUT_ERROR} the input is invalid (one line says where){input_error}"]
    parts += [f"{EXIT_NEGATIVE_RESULT} {unusable}"] if unusable else []
    return textwrap.fill(f"Exit status: {'; '.join(parts)}; {INTERNAL_ERROR} an internal error.", HELP_WIDTH) + "\n"


def input_error_message(error: Exception) -> str | None:
    """Return the message of an error that the user can correct, None for an internal error."""
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, OSError):
        expected = next((text for kind, text in _PATH_ERRORS.items() if isinstance(error, kind)), None)
        if expected is not None:
            return f"{error.filename}: expected {expected}" if error.filename is not None else str(error)
        if error.errno in WRITE_ERRORS:
            return f"{error.filename or 'output'}: {error.strerror}"
    if isinstance(error, ModuleNotFoundError) and (extra := missing_extra(error.name)) is not None:
        return f"needs metric-tree[{extra}]: pip install 'metric-tree[{extra}]'"
    return None


def _report(program: str, message: str, status: int) -> int:
    with suppress(OSError):  # standard error is closed
        sys.stderr.write(f"{program}: {visible(' '.join(message.split()))}\n")
    return status


def configure_streams() -> None:
    """Make standard output and error accept every character; replace a closed stream by the null device."""
    codecs.register_error(_HANDLER, _plain)
    # a stream that was closed at the start is None
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def flush_or_discard(stream: TextIO) -> None:
    """Flush the stream, or discard its content if that fails, so that the last flush at exit does not fail."""
    try:
        stream.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
