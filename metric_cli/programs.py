"""The console scripts. A command is imported inside them, so that Ctrl-C is one line from the start on."""

from __future__ import annotations

import sys
from contextlib import suppress
from importlib import import_module

from metric_cli.signals import INTERRUPTED

__all__ = ["estimate_scale", "insert_object", "metric_tree"]


def metric_tree() -> int:
    """The console script `metric-tree`."""
    return _start("metric_cli.subcommands", "metric-tree")


def estimate_scale() -> int:
    """The console script `estimate-scale`."""
    return _start("metric_cli.estimate_scale.estimate", "estimate-scale")


def insert_object() -> int:
    """The console script `insert-object`."""
    return _start("metric_cli.insert_object.insert", "insert-object")


def _start(module: str, program: str) -> int:
    """Import a command and run it: the import takes half a second, in which Ctrl-C is one line, too."""
    try:
        status: int = import_module(module).main()
    except KeyboardInterrupt:
        with suppress(OSError):  # nobody reads it
            sys.stderr.write(f"{program}: interrupted\n")
        return INTERRUPTED
    return status
