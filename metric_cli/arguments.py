"""Arguments that name paths: what a run reads and what it writes, so that no output replaces a file of others."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from metric_base.errors import InputError
from metric_base.outputs import check_output, set_rules

__all__ = ["OutputFile", "add_overwrite", "arguments_of", "check_paths", "input_path", "new_folder", "output_folder"]


def input_path(text: str) -> Path:
    """The type of an argument that names something to read."""
    return Path(text)


def output_folder(text: str) -> Path:
    """The type of an argument that names a folder in which a command keeps its files, beside those of others."""
    return Path(text)


def new_folder(text: str) -> Path:
    """The type of an argument that names a folder to write, which must not be there yet."""
    return Path(text)


class OutputFile:
    """The type of an argument that names a file to write.

    schema : of the JSON that it may replace; None where the file is none: a page over a manifest is no new page.
    """

    def __init__(self, schema: str | None = None) -> None:
        self.schema = schema

    def __call__(self, text: str) -> Path:
        """The path."""
        return Path(text)


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Add `--overwrite` where a file is written."""
    if any(isinstance(action.type, OutputFile) for action in arguments_of(parser)):
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
    actions = list(arguments_of(parser))
    written = {
        one.dest for one in actions if isinstance(one.type, OutputFile) or one.type in (output_folder, new_folder)
    }
    values = [value for name, value in vars(options).items() if name not in written]
    set_rules(list(_existing(values)), bool(getattr(options, "overwrite", False)))
    for action in actions:
        path, kind = getattr(options, action.dest, None), action.type
        name = next(iter(action.option_strings), str(action.metavar))
        if path is not None and isinstance(kind, OutputFile):
            check_output(path, name, kind.schema)
        if path is not None and kind is new_folder and os.path.lexists(path):
            raise InputError(f"{name}: expected a folder that is not there yet; found an existing one: {path}")


def arguments_of(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """The arguments of a parser and of the verbs below it."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from arguments_of(below)


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
