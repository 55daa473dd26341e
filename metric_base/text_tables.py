"""Tables of names with a text each, in text files: codes of findings, reasons, countries, units."""

from __future__ import annotations

import re
from pathlib import Path


def named_texts(file: Path) -> dict[str, str]:
    """Read the texts of a file by the name at the beginning of their line, in order.

    Empty lines and lines that begin with # are ignored; a line without a text has an empty one.
    """
    lines = (line for line in file.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#"))
    return {name: text for name, _, text in (line.partition(" ") for line in lines)}


def text_sections(file: Path) -> dict[str, str]:
    """Read the lines of a file below each name in brackets, without empty lines and lines that begin with #."""
    lines = (line for line in file.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#"))
    _, *parts = re.split(r"^\[([a-z_ ]+)\]\n", "\n".join(lines), flags=re.MULTILINE)
    return {name: text.strip() for name, text in zip(parts[::2], parts[1::2], strict=True)}
