"""Arguments that name paths: what a run reads and what it writes, so that no output replaces a file of others."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from metric_base.outputs import ANY_SCHEMA, check_output, set_rules

__all__ = ["OutputFile", "add_overwrite", "check_paths", "input_path", "output_folder"]


def input_path(text: str) -> Path:
    """The type of an argument that names something to read."""
    return Path(text)


def output_folder(text: str) -> Path:
    """The type of an argument that names a folder to write: a new one, or one in which a command keeps its files."""
    return Path(text)


class OutputFile:
    """The type of an argument that names a file to write; schema : of the JSON that it may replace."""

    def __init__(self, schema: str = ANY_SCHEMA) -> None:
        self.schema = schema

    def __call__(self, text: str) -> Path:
        """The path."""
        return Path(text)


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Add `--overwrite` where a file is written."""
    if any(isinstance(action.type, OutputFile) for action in parser._actions):
        words = "replace existing files of others, too; an input of the run is never replaced"
        parser.add_argument("--overwrite", action="store_true", help=words)


def check_paths(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """See that no output would replace an input or a file of others: before any work.

    Every value that names something existing, but for the outputs, is an input.

    Raises
    ------
    InputError
        An output may not be written.
    """
    outputs = [action for action in parser._actions if isinstance(action.type, OutputFile)]
    folders = [action for action in parser._actions if action.type is output_folder]
    written = {action.dest for action in (*outputs, *folders)}
    values = [value for name, value in vars(options).items() if name not in written]
    set_rules(list(_existing(values)), bool(getattr(options, "overwrite", False)))
    for action in outputs:
        path, kind = getattr(options, action.dest, None), action.type
        if path is not None and isinstance(kind, OutputFile):
            check_output(path, action.option_strings[0] if action.option_strings else action.dest, kind.schema)


def _existing(values: Iterable[Any]) -> Iterator[Path]:
    """Every text or path among the values, in lists and tables too, that names something existing."""
    for value in values:
        if isinstance(value, list | tuple):
            yield from _existing(value)
        elif isinstance(value, dict):
            yield from _existing(value.values())
        elif isinstance(value, str | Path) and str(value) and _exists(value):
            yield Path(value)


def _exists(value: str | Path) -> bool:
    try:
        return os.path.lexists(value)
    except (OSError, ValueError):
        return False
