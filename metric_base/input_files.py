"""Read untrusted files of bounded size as bytes, text or JSON; every error is one line that names the file."""

from __future__ import annotations

import gc
import itertools
import json
import os
import re
import select
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from metric_base.errors import InputError, Unquoted
from metric_base.operating_system import READ_FLAGS

#: Escape of a surrogate in JSON; half of a pair is not a valid character.
_HALF_CHARACTER = re.compile(r"\\u[dD][89a-fA-F]")
#: Standard input by the name that commands give it.
STDIN = "-"
#: Maximum sizes of files: in memory, text needs three times and JSON about ten times the size of the file (the largest
#: annotations of COCO, of 118,000 images, have 450 MB).
MAX_BYTES, MAX_TEXT_BYTES, MAX_JSON_BYTES = 1 << 33, 1 << 31, 1 << 29
#: Maximum number of files in a folder of images or masks: ten hours of video at three images per second.
MAX_ENTRIES = 100_000
#: Maximum time that a pipe may have no writer, in seconds.
PIPE_SECONDS = 2.0
_PIPE_BYTES = 1 << 20


def read_bytes(path: Path, most: int = -1, limit: int = MAX_BYTES, *, may_be_empty: bool = False) -> bytes:
    """Read a file, or its first `most` bytes; `-` is standard input.

    Raises
    ------
    InputError
        The file is missing, a folder, a device, unreadable, empty, or has more than `limit` bytes; or it is a pipe
        without a writer.
    """
    with open_file(path) as descriptor:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISREG(mode):
            size = os.fstat(descriptor).st_size
            if most < 0 and size > limit:
                raise InputError.at(path, "file", f"at most {limit:,} bytes", Unquoted(f"{size:,}"))
            with os.fdopen(os.dup(descriptor), "rb") as file:
                data = file.read(most)
        elif stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or str(path) == STDIN:
            data = _read_pipe(path, descriptor, limit if most < 0 else most, whole=most < 0)
        else:
            kind = "a folder" if stat.S_ISDIR(mode) else "a device"
            raise InputError.at(path, "file", "a regular file or a pipe", Unquoted(kind))
    if not data and not may_be_empty:
        raise InputError.at(path, "file", "some content", Unquoted("zero bytes"))
    return data


@contextmanager
def open_file(path: Path) -> Iterator[int]:
    """Open a file without waiting and provide its descriptor; errors of the system become InputError."""
    with _refusals(path, "file"):
        try:
            # `open` would wait for the writer of a pipe
            descriptor = os.dup(0) if str(path) == STDIN else os.open(path, READ_FLAGS)
        except ValueError:  # a zero byte in the name
            raise InputError.at(path, "file", "a name of a file", str(path)) from None
        try:
            yield descriptor
        finally:
            os.close(descriptor)


@contextmanager
def _refusals(path: Path, kind: str) -> Iterator[None]:
    """Convert an error of the system in the block to an error of the input; kind : `file` or `folder`."""
    try:
        yield
    except OSError as error:
        raise InputError.at(path, kind, f"a readable {kind}", Unquoted(error.strerror or "an error")) from None


def _read_pipe(path: Path, descriptor: int, limit: int, whole: bool) -> bytes:
    """Read at most `limit` bytes from a pipe; more are an error if the whole content is required."""
    parts, size, patience = [], 0, time.monotonic() + PIPE_SECONDS
    while size <= limit:
        try:
            part = os.read(descriptor, min(_PIPE_BYTES, limit + 1 - size))
        except BlockingIOError:  # the writer has the pipe open and is not ready
            select.select([descriptor], [], [])
            continue
        if part:
            parts.append(part)
            size += len(part)
        elif size or time.monotonic() > patience or str(path) == STDIN:
            return b"".join(parts)
        else:  # no writer has opened it yet
            time.sleep(0.02)
    if whole:
        raise InputError.at(path, "file", f"at most {limit:,} bytes", Unquoted("more"))
    return b"".join(parts)[:limit]


def is_file(path: Path) -> bool:
    """Return True if there is a regular file; invalid and too long names are no error."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def folder_entries(folder: Path) -> list[Path]:
    """Return the entries of a folder in the order of their names.

    Raises
    ------
    InputError
        The folder cannot be listed, or has more than MAX_ENTRIES entries.
    """
    with _refusals(folder, "folder"), os.scandir(folder) as entries:
        names = [entry.name for entry in itertools.islice(entries, MAX_ENTRIES + 1)]
    if len(names) > MAX_ENTRIES:
        raise InputError.at(folder, "folder", f"at most {MAX_ENTRIES:,} entries", Unquoted("more"))
    return [folder / name for name in sorted(names)]


def read_text(path: Path, limit: int = MAX_TEXT_BYTES, *, may_be_empty: bool = False) -> str:
    """Return the content of a file as UTF-8."""
    try:
        return read_bytes(path, limit=limit, may_be_empty=may_be_empty).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte = Unquoted(f"byte {error.object[error.start]:#04x} at {error.start}")
        raise InputError.at(path, "encoding", "UTF-8", byte) from None


def read_json(path: Path) -> Any:
    """Return the JSON document of a file."""
    text = read_text(path, MAX_JSON_BYTES)
    collecting = gc.isenabled()
    gc.disable()  # a document has no cycles, and the search for them in a million points takes longer than reading
    try:
        document = json.loads(text)
        if _HALF_CHARACTER.search(text):
            json.dumps(document, ensure_ascii=False).encode()
        return document
    except UnicodeEncodeError:
        raise InputError.at(path, "JSON", "whole characters", Unquoted("half of a surrogate pair")) from None
    except RecursionError:
        raise InputError.at(path, "JSON", "a document of ordinary depth", Unquoted("endless nesting")) from None
    except json.JSONDecodeError as error:
        error_place = Unquoted(f"{error.msg} at line {error.lineno}, column {error.colno}")
        raise InputError.at(path, "JSON", "a valid document", error_place) from None
    except ValueError as error:  # an integer of thousands of digits
        raise InputError.at(path, "JSON", "a valid document", Unquoted(str(error))) from None
    finally:
        if collecting:
            gc.enable()
