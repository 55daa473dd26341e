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
from typing import TextIO

from metric_base.errors import InputError
from metric_base.escaping import visible
from metric_base.files import WRITE_ERRORS
from metric_cli.parser import HELP_WIDTH
from metric_cli.programs import INTERRUPTED, Terminated, orderly_termination
from metric_cli.tables import _HANDLER, _plain

#: The modules that an extra of `pyproject.toml` brings. A module may be in several; the first is the one to name.
MODULES_BY_EXTRA: dict[str, tuple[str, ...]] = {
    "scene": ("cv2", "matplotlib", "PIL", "pycocotools", "pycolmap", "scipy", "sklearn"),
    "detect": ("onnxruntime",),
    "video": ("av",),
    "insert": ("moderngl",),
    "usd": ("pxr",),
    "crawl": ("scrapy", "lxml", "extruct", "redis", "twisted", "w3lib"),
    "build": ("nltk", "pooch", "requests", "xlrd", "yaml"),
    "images": ("rembg",),
    "assets": ("trimesh", "collada", "lxml"),
    "cluster": ("distributed",),
    "serve": ("jinja2", "markupsafe", "starlette", "uvicorn"),
    "mcp": ("mcp",),
    "pandas": ("pandas",),
    "view": ("open3d",),
}
#: Set to see the traceback of an internal error.
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
DONE, INTERNAL_ERROR, INPUT_ERROR, EXIT_NEGATIVE_RESULT, TERMINATED = 0, 1, 2, 3, 143


def missing_extra(module: str | None) -> str | None:
    """The extra that brings a module, or None if no extra does.

    >>> missing_extra("scrapy.http")
    'crawl'
    """
    root = (module or "").partition(".")[0]
    return next((extra for extra, modules in MODULES_BY_EXTRA.items() if root in modules), None)


def exit_status(program: str, run: Callable[[], int]) -> int:
    """Run a command: 2 with one line for an error of the input, 1 with one line for an internal error.

    Ctrl-C and a request to terminate end it with one line and status 130 or 143, after its temporary files are
    removed. A closed standard output is no error.
    """
    configure_streams()
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
    flush_or_discard(sys.stdout)
    return status


def exit_status_help(done: str = "", input_error: str = "", unusable: str = "") -> str:
    """Return the description of the exit statuses for the end of a help text."""
    parts = [f"{DONE} done{done}", f"{INPUT_ERROR} the input is invalid (one line says where){input_error}"]
    parts += [f"{EXIT_NEGATIVE_RESULT} {unusable}"] if unusable else []
    return textwrap.fill(f"Exit status: {'; '.join(parts)}; {INTERNAL_ERROR} an internal error.", HELP_WIDTH) + "\n"


def _path_error(error: OSError) -> str:
    expected = next(text for kind, text in _PATH_ERRORS.items() if isinstance(error, kind))
    return f"{error.filename}: expected {expected}" if error.filename is not None else str(error)


def _error_status(program: str, error: Exception) -> int:
    message = _input_error(error)
    if message is not None:
        return _report(program, message, INPUT_ERROR)
    if os.environ.get(DEBUG_ENV):
        traceback.print_exc()
    return _report(program, f"internal error: {type(error).__name__}: {error}", INTERNAL_ERROR)


def _input_error(error: Exception) -> str | None:
    """Return the message of an error that the user can correct, None for an internal error."""
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


def configure_streams() -> None:
    """Make standard output and error take every character; a stream that is closed becomes silent."""
    codecs.register_error(_HANDLER, _plain)
    # a stream is None where the program was started with it closed
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
