"""Arguments that name paths: what a run reads and what it writes, so that no output replaces a file of others.

Completion scripts for shells, made from the programs' own options and subcommands.

What the parsers of several commands have alike: the options of every program, and of a release.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from metric_base.errors import InputError
from metric_base.files import check_output, set_rules
from metric_base.spelling import advice, near_spellings

#: Columns of the paragraphs below the options of a help.
HELP_WIDTH = 120
SHELLS = ("bash", "zsh", "fish")


class OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line, with the option that was probably meant.

    A value may begin with a minus and a digit, such as the list `-0.5,0.2`, which older versions of argparse take for
    an option.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # as of Python 3.14; before, whole numbers alone

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """The options; an output that would replace an input or a file of others is an error."""
        options = super().parse_args(args, namespace)
        check_paths(self, options)
        return options

    def error(self, message: str) -> NoReturn:
        """Raise what is wrong as an error of the input."""
        unknown = re.match(r"unrecognized arguments: (.*)", message)
        if unknown is None:
            raise InputError(f"arguments: {message} (--help lists them)")
        word = next((word for word in unknown[1].split() if word.startswith("-")), unknown[1].strip())
        near = near_spellings(word.partition("=")[0], self._option_string_actions, n=1)
        raise InputError(f"arguments: no option is called {word}{advice(near) or '; --help lists them'}")


class PrintVersion(argparse.Action):
    """Print the versions of the program and of the release of the tree, and exit."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help="print the versions of program and data, and exit")

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        """Print the versions and end the program."""
        from metric_tree.release.registry import release_directory

        sys.stdout.write(f"{parser.prog} {version()} (object sizes: release {release_directory().name})\n")
        parser.exit()


def version() -> str:
    """The version of the installed distribution."""
    from importlib import metadata  # with it comes `email`

    try:
        return metadata.version("metric-tree")
    except metadata.PackageNotFoundError:
        return "0+source"


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

    schema : str, optional
        Schema of the JSON file that the command continues or replaces without `--overwrite`.
    """

    def __init__(self, schema: str | None = None) -> None:
        self.schema = schema

    def __call__(self, text: str) -> Path:
        """The path."""
        return Path(text)


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Add `--overwrite` where a file is written."""
    if any(isinstance(action.type, OutputFile) for action in arguments_of(parser)):
        words = "replace existing files; an input of the run is never replaced"
        parser.add_argument("--overwrite", action="store_true", help=words)


def check_paths(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Check before any work that no output would replace an input or an existing file.

    Every value that names an existing file or folder, except for the outputs, is an input.

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
    """The arguments of a parser and of the subcommands below it."""
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


class PrintCompletion(argparse.Action):
    """Print the completion script of a shell, and leave."""

    def __call__(self, root: argparse.ArgumentParser, _options: Any, shell: Any, _name: str | None = None) -> NoReturn:
        """Write the script to standard output."""
        sys.stdout.write(completion_script(root.prog, {"": option_helps(root)}, shell))
        root.exit()


def option_helps(parser: argparse.ArgumentParser) -> dict[str, str]:
    """The help of each long option of a parser, by the option's name."""
    actions = sorted(parser._option_string_actions.items())
    return {name: action.help or "" for name, action in actions if name.startswith("--")}


def completion_script(program: str, subcommands: Mapping[str, Mapping[str, str]], shell: str) -> str:
    """Return the script with which a shell completes subcommands, options and files of a program.

    subcommands : help by option, by subcommand; `""` is the subcommand of a program without subcommands.
    """
    if shell == "fish":
        return "".join(_fish_lines(program, subcommand, options) for subcommand, options in subcommands.items())
    names = " ".join(subcommand for subcommand in subcommands if subcommand)
    cases = "".join(
        f'        "{subcommand}") words="{" ".join(options)}" ;;\n'
        for subcommand, options in subcommands.items()
        if subcommand
    )
    function = f"_{program.replace('-', '_')}"
    choice = f'    case "${{COMP_WORDS[1]}}" in\n{cases}    esac\n' if names else ""
    first = f'    if [[ $COMP_CWORD -eq 1 ]]; then words="{names} $words"; fi\n' if names else ""
    listed = '"$word" == -* || $COMP_CWORD -eq 1' if names else '"$word" == -*'
    bash = f"""{function}() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" words="{" ".join(subcommands.get("", {}))}"
{choice}{first}    if [[ {listed} ]]; then
        COMPREPLY=($(compgen -W "$words" -- "$word"))
    else
        COMPREPLY=($(compgen -f -- "$word"))
    fi
}}
complete -o filenames -F {function} {program}
"""
    return bash if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{bash}"


def _fish_lines(program: str, subcommand: str, options: Mapping[str, str]) -> str:
    named = f"complete -c {program} -n __fish_use_subcommand -a {subcommand}\n" if subcommand else ""
    where = f" -n '__fish_seen_subcommand_from {subcommand}'" if subcommand else ""
    lines = (f"complete -c {program}{where} -l {name[2:]} -d '{_quoted(text)}'\n" for name, text in options.items())
    return named + "".join(lines)


def _quoted(text: str) -> str:
    """Text between single quotes of fish; argparse's own %s are not for a shell."""
    return text.replace("%(default)s", "see --help").replace("\\", "\\\\").replace("'", "\\'")


def program_parser(program: str, description: str, epilog: str, usage: str) -> OneLineParser:
    """Return the parser of a program without subcommands; `usage` states the required and the common arguments."""
    return OneLineParser(
        prog=program,
        usage=usage,
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
    root.add_argument("--version", action=PrintVersion)
    add_overwrite(root)


def add_tree(parser: argparse.ArgumentParser) -> None:
    """The option that names a release."""
    parser.add_argument("--tree", metavar="REF", help="version or folder of a release (default: the shipped one)")
