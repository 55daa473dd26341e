"""What the parsers of several commands have alike: the options of every program, and of a release."""

from __future__ import annotations

import argparse

from metric_cli.arguments import add_overwrite
from metric_cli.completion import SHELLS, PrintCompletion
from metric_cli.tables import OneLineParser, version

__all__ = ["add_program_options", "add_tree", "program_parser"]


def program_parser(program: str, description: str, epilog: str) -> OneLineParser:
    """The parser of a program without verbs."""
    return OneLineParser(
        prog=program,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )


def add_program_options(root: OneLineParser) -> None:
    """The options of every such program, last."""
    root.add_argument(
        "--completion", choices=SHELLS, action=PrintCompletion, help="print the completion script of a shell"
    )
    root.add_argument("--version", action="version", version=f"{root.prog} {version()}")
    add_overwrite(root)


def add_tree(parser: argparse.ArgumentParser) -> None:
    """The option that names a release."""
    parser.add_argument("--tree", metavar="REF", help="version or folder of a release (default: the shipped one)")
