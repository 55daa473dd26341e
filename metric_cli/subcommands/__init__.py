"""The `metric-tree` command: one module per subcommand in a folder per topic, imported when it is called.

A subcommand's module has `HELP` (one line), `add_arguments(parser)` and `run(arguments)`, which returns an exit status
if it may be another than 0.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from metric_cli.errors import EXIT_OK, INPUT_ERROR, exit_status
from metric_cli.parser import SHELLS, OneLineParser, PrintVersion, add_overwrite, completion_script, option_helps
from metric_cli.programs import use_one_thread

__all__ = ["SUBCOMMANDS", "main", "parser_of"]

#: Module and help line of each subcommand in the overview, by topic; `HELP` of the module describes it in full.
SUBCOMMANDS = {
    "query": ("release.query", "size, path, counts and prior of a category"),
    "search": ("release.search", "categories for a text"),
    "list": ("release.list_", "the available releases"),
    "priors": ("release.priors", "sizes as a flat table"),
    "diff": ("release.diff", "differences between two releases"),
    "report": ("release.report", "readable page about a release"),
    "serve": ("release.serve", "the explorer and its JSON over HTTP"),
    "site": ("release.site", "the explorer as files"),
    "cite": ("release.cite", "citation, basis and attributions of a release"),
    "fetch": ("release.fetch", "download a release from a registry"),
    "publish": ("release.publish", "a release as a folder for a data hub"),
    "validate": ("release.validate", "check all rules of a release"),
    "check-asset": ("models.check_asset", "check whether 3-D models have true size"),
    "true-size": ("models.true_size", "find the true size of a model and rescale it"),
    "render": ("models.render", "render items that have a textured model"),
    "crawl": ("data.crawl", "run a spider into a raw-item data set"),
    "extract": ("data.extract", "one saved web page to a raw item"),
    "import": ("data.import_", "open data sets to raw items"),
    "build": ("data.build", "raw items to a release"),
    "review": ("data.review", "list open questions for reviewers, or record a decision"),
    "explain": ("data.explain", "why an item is in its category"),
    "select": ("training.select", "categories for segmentation and scale estimation"),
    "cutout": ("training.cutout", "foreground masks for the images of a release"),
    "export": ("training.export", "training data for instance segmentation"),
}
#: Heading of each topic in the overview.
TOPICS = {
    "release": "sizes and releases",
    "models": "3-D models",
    "data": "from web pages and open data sets to a release",
    "training": "training data for detectors",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run `metric-tree` and return the exit status: 0, 2 for an invalid input, 1 for an internal error."""
    use_one_thread()
    arguments = list(sys.argv[1:] if argv is None else argv)
    if len(arguments) == 2 and arguments[0] == "--completion" and arguments[1] in SHELLS:
        options = {"--completion": "", "--help": "", "--version": ""}
        subcommands = {"": options, **{name: option_helps(parser_of(name)) for name in SUBCOMMANDS}}
        sys.stdout.write(completion_script("metric-tree", subcommands, arguments[1]))
        return EXIT_OK
    if arguments and arguments[0] in SUBCOMMANDS:
        name, *rest = arguments

        def run() -> int:
            if name == "check-asset":
                from metric_cli.batch import batch_run
                from metric_cli.subcommands.models.check_asset import BATCH

                if (batch := batch_run(BATCH, rest)) is not None:
                    return batch()
            options = parser_of(name).parse_args(rest)
            status: int | None = options.run(options)
            return EXIT_OK if status is None else status

        return exit_status(f"metric-tree {name}", run)
    parser = overview_parser()
    if not arguments:
        parser.print_help()
        return EXIT_OK
    general = {"-h", "--help", "--version"}
    is_completion = arguments[0] == "--completion"
    parser.parse_args(arguments if is_completion else [argument for argument in arguments if argument in general])
    expected = f"expected one of {', '.join(SUBCOMMANDS)}; found {arguments[0]!r}"
    sys.stderr.write(f"metric-tree: subcommand: {expected}\n")
    return INPUT_ERROR


def parser_of(subcommand: str) -> argparse.ArgumentParser:
    """Return the argument parser of a subcommand."""
    module = import_module(f"metric_cli.subcommands.{SUBCOMMANDS[subcommand][0]}")
    parser = OneLineParser(
        prog=f"metric-tree {subcommand}", description=module.HELP, conflict_handler="resolve", allow_abbrev=False
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    module.add_arguments(parser)
    add_overwrite(parser)
    parser.set_defaults(run=module.run)
    return parser


def overview_parser() -> argparse.ArgumentParser:
    """Return the parser of `metric-tree` without a subcommand; its help lists the subcommands by topic."""
    width = max(map(len, SUBCOMMANDS))
    lines = []
    for topic, heading in TOPICS.items():
        rows = ((name, text) for name, (module, text) in SUBCOMMANDS.items() if module.partition(".")[0] == topic)
        lines += [f"{heading}:", *(f"  {name:<{width}}  {text}" for name, text in rows), ""]
    parser = argparse.ArgumentParser(
        prog="metric-tree",
        usage="metric-tree SUBCOMMAND [ARGUMENT ...]",
        description="Object sizes by category, from raw data to priors.",
        epilog="\n".join([*lines, "`metric-tree SUBCOMMAND --help` lists the arguments of a subcommand."]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=PrintVersion)
    parser.add_argument("--completion", choices=SHELLS, help="print the completion script of a shell")
    return parser
