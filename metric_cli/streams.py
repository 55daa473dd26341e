"""Standard output and error that take any text: closed streams are quiet, and no character is an error."""

from __future__ import annotations

import codecs
import io
import os
import sys
from contextlib import suppress
from typing import TextIO

__all__ = ["flush_or_silence", "make_streams_forgiving"]

#: A replacement for each of our signs in an encoding that lacks it; anything else is written as an escape.
PLAIN = {"×": "x", "±": "+-", "–": "-", "−": "-", "…": "...", "→": "->", "≤": "<=", "≥": ">=", "°": " deg", "─": "-"}
_HANDLER = "metric-base-plain"


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
