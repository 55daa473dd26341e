"""The `metric-tree` command: one module per subcommand in a folder per topic, imported when it is called.

A subcommand's module has `HELP` (one line), `add_arguments(parser)` and `run(arguments) -> exit status`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from metric_cli.errors import exit_status
from metric_cli.parser import SHELLS, OneLineParser, add_overwrite, completion_script, option_helps, version
from metric_cli.programs import use_one_thread

__all__ = ["VERBS", "main", "parser_of"]

#: Help line of each subcommand in the overview; `HELP` of its module describes it in full.
VERBS = {
    "query": "a category: path, counts, sizes, prior",
    "list": "the available releases",
    "extract": "one saved web page to a raw item",
    "crawl": "run a spider into a raw-item data set",
    "import": "an open data set into raw items",
    "build": "raw items to a release",
    "review": "what waits for a reviewer; record a decision",
    "explain": "why an item is in its category",
    "validate": "every rule of a release",
    "report": "a readable page about a release",
    "check-asset": "whether 3-D models are at true size",
    "true-size": "the true size of a model without one",
    "select": "the categories fit for segmentation and scale",
    "render": "pictures of items that have a textured model",
    "cutout": "foreground masks for the images of a release",
    "export": "training data for instance segmentation",
    "search": "categories for a text",
    "priors": "sizes as a flat table",
    "diff": "what changed between two releases",
    "fetch": "a release from a registry",
    "publish": "a release as a folder for a data hub",
    "serve": "the explorer and its JSON over HTTP",
    "site": "the explorer as files",
}

#: Folder of the modules of each topic.
_TOPICS = {
    **dict.fromkeys(("build", "crawl", "explain", "extract", "import", "review"), "data"),
    **dict.fromkeys(("check-asset", "render", "true-size"), "models"),
    **dict.fromkeys(("cutout", "export", "select"), "training"),
    **dict.fromkeys(
        ("diff", "fetch", "list", "priors", "publish", "query", "report", "search", "serve", "site", "validate"),
        "release",
    ),
}
#: Modules whose names would hide a keyword or a built-in type.
_MODULES = {"import": "import_", "list": "list_"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run `metric-tree`; the exit status is 0 done, 2 the input is invalid, 1 the program is."""
    use_one_thread()
    words = list(sys.argv[1:] if argv is None else argv)
    if len(words) == 2 and words[0] == "--completion" and words[1] in SHELLS:
        options = {"--completion": "", "--help": "", "--version": ""}
        verbs = {"": options, **{verb: option_helps(parser_of(verb)) for verb in VERBS}}
        sys.stdout.write(completion_script("metric-tree", verbs, words[1]))
        return 0
    if not words or words[0] not in VERBS:
        return _overview(words)
    return exit_status(f"metric-tree {words[0]}", lambda: _run(words[0], words[1:]))


def parser_of(verb: str) -> argparse.ArgumentParser:
    """The argument parser of a verb."""
    name = _MODULES.get(verb, verb.replace("-", "_"))
    module = import_module(f"metric_cli.subcommands.{_TOPICS[verb]}.{name}")
    parser = OneLineParser(
        prog=f"metric-tree {verb}", description=module.HELP, conflict_handler="resolve", allow_abbrev=False
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    module.add_arguments(parser)
    add_overwrite(parser)
    parser.set_defaults(run=module.run)
    return parser


def _run(verb: str, words: Sequence[str]) -> int:
    arguments = parser_of(verb).parse_args(words)
    status: int = arguments.run(arguments)
    return status


def _overview(words: Sequence[str]) -> int:
    parser = _overview_parser()
    if not words:
        parser.print_help()
        return 0
    parser.parse_args(
        words if words[0] == "--completion" else [word for word in words if word in {"-h", "--help", "--version"}]
    )
    sys.stderr.write(f"metric-tree: verb: expected one of {', '.join(VERBS)}; found {words[0]!r}\n")
    return 2


def _overview_parser() -> argparse.ArgumentParser:
    width = max(map(len, VERBS))
    verbs = "\n".join(f"  {verb:<{width}}  {what}" for verb, what in VERBS.items())
    parser = argparse.ArgumentParser(
        prog="metric-tree",
        usage="metric-tree VERB [ARGUMENT ...]",
        description="Object sizes by category, from raw data to priors.",
        epilog=f"verbs:\n{verbs}\n\n`metric-tree VERB --help` says what a verb takes.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"metric-tree {version()}")
    parser.add_argument("--completion", choices=SHELLS, help="print the completion script of a shell")
    return parser
