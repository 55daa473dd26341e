"""Parsers with one-line errors, types of path arguments with a check of outputs, shared options, and completion."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any, NoReturn

from metric_base.errors import InputError
from metric_base.files import check_output, set_rules
from metric_base.remote import fetched, is_remote, staged, url_of, without_file_scheme
from metric_base.spelling import advice, near_spellings

#: Width of the paragraphs below the options of a help text in columns.
HELP_WIDTH = 120
SHELLS = ("bash", "zsh", "fish")


class OneLineParser(argparse.ArgumentParser):
    """Parser with one-line errors that suggest a similar option.

    A value may begin with a minus and a digit, such as the list `-0.5,0.2`, which older versions of argparse treat as
    an option.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # as in Python 3.14; earlier, only complete numbers

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments. Raises InputError if an output would replace an input or another existing file."""
        options = super().parse_args(args, namespace)
        check_paths(self, options)
        return options

    def error(self, message: str) -> NoReturn:
        """Raise InputError with the message; if an option is unknown, with a similar one."""
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
    """Return the version of the installed distribution."""
    from importlib import metadata  # imports `email`

    try:
        return metadata.version("metric-tree")
    except metadata.PackageNotFoundError:
        return "0+source"


def input_path(text: str) -> Path:
    """Type of an argument that names an input."""
    return Path(text)


def streamed_path(text: str) -> Path:
    """Type of an argument that names an input that is read at its URL, without a local copy."""
    return without_file_scheme(Path(text))


def output_folder(text: str) -> Path:
    """Type of an argument that names an output folder, which may contain other files."""
    return Path(text)


def new_folder(text: str) -> Path:
    """Type of an argument that names an output folder that must not exist."""
    return Path(text)


class OutputFile:
    """Type of an argument that names an output file.

    schema : str, optional
        Schema of the JSON file that the command continues or replaces without `--overwrite`.
    """

    def __init__(self, schema: str | None = None) -> None:
        self.schema = schema

    def __call__(self, text: str) -> Path:
        """Return the path."""
        return Path(text)


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Add `--overwrite` to a parser with an output file, and to its subcommands that have one."""
    for action in parser._actions:
        for below in action.choices.values() if isinstance(action, argparse._SubParsersAction) else ():
            add_overwrite(below)
    if any(isinstance(action.type, OutputFile) for action in parser._actions):
        parser.add_argument("--overwrite", action="store_true", help="replace existing files")


def check_paths(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Check before any work that no output would replace an input or an existing file; URLs become local paths.

    Every value that names an existing file or folder, except for the outputs, is an input.

    Raises
    ------
    InputError
        An output may not be written, or a URL cannot be used.
    """
    actions = list(arguments_of(parser))
    kinds = {one.dest: one.type for one in actions}
    for dest, value in list(vars(options).items()):
        kind, option = kinds.get(dest), f"--{dest.replace('_', '-')}"
        if value is None or kind is streamed_path:
            continue
        if kind is output_folder and is_remote(value):
            raise InputError(
                f"{option}: expected a local folder, in which a later run continues; found {url_of(value)}"
            )
        if isinstance(kind, OutputFile) or kind is new_folder:
            may_exist = isinstance(kind, OutputFile) and bool(getattr(options, "overwrite", False))
            setattr(options, dest, staged(value, option, may_exist=may_exist))
        else:
            setattr(options, dest, _fetched(value))
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


def _fetched(value: Any) -> Any:
    """Return a value of an option in which the URLs are replaced by the paths of local copies."""
    if isinstance(value, list):
        return [_fetched(one) for one in value]
    if isinstance(value, argparse.Namespace):  # of one of several objects
        return argparse.Namespace(**{name: _fetched(one) for name, one in vars(value).items()})
    return fetched(value) if isinstance(value, Path) else value


def same_named(options: argparse.Namespace, record: Any) -> dict[str, Any]:
    """Return the values of the options whose names are those of fields of a dataclass."""
    names = {field.name for field in fields(record)}
    return {name: value for name, value in vars(options).items() if name in names}


def parse_part(text: str | None) -> tuple[int, int]:
    """Parse `--part I/N` with I from 1 to N; None is the only part.

    Raises
    ------
    InputError
        The text has another form.
    """
    part = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text or "1/1")
    if part is None or not 1 <= int(part[1]) <= int(part[2]):
        raise InputError.at("--part", "part", "I/N with I from 1 to N, such as 3/8", text)
    return int(part[1]), int(part[2])


def parse_up(text: str) -> tuple[float, ...]:
    """Parse the direction `--up`, X,Y,Z of any length except 0."""
    from estimator.geometry.vertical import up_from_vector

    try:
        direction = tuple(float(part) for part in text.split(","))
        up_from_vector(direction)
    except ValueError:  # InputError is one
        raise InputError.at("--up", "direction", "X,Y,Z, three finite numbers, not all 0", text) from None
    return direction


def arguments_of(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the arguments of a parser and of its subcommands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from arguments_of(below)


def _existing(values: Iterable[Any]) -> Iterator[Path]:
    """Yield the existing paths among texts and paths, also in lists and dictionaries."""
    for value in values:
        if isinstance(value, list | tuple):
            yield from _existing(value)
        elif isinstance(value, dict):
            yield from _existing(value.values())
        elif isinstance(value, str | Path) and str(value):
            with suppress(OSError, ValueError):  # the text cannot be a path
                if os.path.lexists(value):
                    yield Path(value)


class PrintCompletion(argparse.Action):
    """Print the completion script of a shell and exit."""

    def __call__(self, root: argparse.ArgumentParser, _options: Any, shell: Any, _name: str | None = None) -> NoReturn:
        """Write the script to standard output."""
        sys.stdout.write(completion_script(root.prog, {"": option_helps(root)}, shell))
        root.exit()


class PrintHelp(argparse.Action):
    """Print the frequent options, or those of a topic, and exit.

    Parameters
    ----------
    frequent : collection of str
        Options and positional arguments that the help without a topic shows.
    """

    def __init__(self, option_strings: Sequence[str], dest: str, frequent: Collection[str], **settings: Any) -> None:
        super().__init__(option_strings, dest, nargs="?", const="", default=argparse.SUPPRESS, **settings)
        self.frequent = frequent

    def __call__(self, root: argparse.ArgumentParser, _options: Any, topic: Any, _name: str | None = None) -> NoReturn:
        """Write the help to standard output. A word that is no topic is ignored."""
        groups = {str(group.title).split()[0]: group for group in root._action_groups if group._group_actions}
        hidden = [a for a in root._actions if not {*self.frequent} & {*a.option_strings, a.dest}]
        if topic in groups:
            hidden = [action for action in root._actions if action not in groups[topic]._group_actions]
        for action in [] if topic == "all" else hidden:
            action.help = argparse.SUPPRESS
        if topic != "all":
            root.epilog = "Exit status: 0 done, 2 invalid input, 3 unresolved, 1 internal error."
        root.print_help()
        root.exit()


def option_helps(parser: argparse.ArgumentParser) -> dict[str, str]:
    """Return the help of each long option of a parser by its name."""
    actions = sorted(parser._option_string_actions.items())
    return {name: action.help or "" for name, action in actions if name.startswith("--")}


def completion_script(program: str, subcommands: Mapping[str, Mapping[str, str]], shell: str) -> str:
    """Return the script with which a shell completes subcommands, options and files of a program.

    subcommands : help by option, by subcommand; `""` is the subcommand of a program without subcommands.
    """
    if shell == "fish":
        lines = []
        for subcommand, options in subcommands.items():
            if subcommand:
                lines.append(f"complete -c {program} -n __fish_use_subcommand -a {subcommand}\n")
            where = f" -n '__fish_seen_subcommand_from {subcommand}'" if subcommand else ""
            for name, text in options.items():
                quoted = text.replace("%(default)s", "see --help").replace("\\", "\\\\").replace("'", "\\'")
                lines.append(f"complete -c {program}{where} -l {name[2:]} -d '{quoted}'\n")
        return "".join(lines)
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


def program_parser(
    program: str, description: str, epilog: str, usage: str, frequent: Collection[str] = ()
) -> OneLineParser:
    """Return the parser of a program without subcommands; `usage` states the required and the common arguments.

    With `frequent` options, `--help` shows only these and the topics of the others.
    """
    root = OneLineParser(
        prog=program,
        usage=usage,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        add_help=not frequent,
    )
    if frequent:
        words = "frequent options, or those of a topic: objects, reconstruction, result, estimate, evidence, batch, all"
        root.add_argument("-h", "--help", metavar="TOPIC", action=PrintHelp, frequent=frequent, help=words)
    return root


def add_program_options(root: OneLineParser) -> None:
    """Add the options that all such programs have, at the end of the help."""
    root.add_argument(
        "--completion", choices=SHELLS, action=PrintCompletion, help="print the completion script of a shell"
    )
    root.add_argument("--version", action=PrintVersion)
    add_overwrite(root)


def add_units(parser: argparse.ArgumentParser) -> None:
    """Add the option that names the unit of the printed tables of sizes."""
    parser.add_argument("--units", choices=("mm", "cm", "in"), default="mm", help="unit of printed sizes (default: mm)")


def add_tree(parser: argparse.ArgumentParser) -> None:
    """Add the option that names a release."""
    parser.add_argument("--tree", metavar="REF", help="release: version or folder (default: shipped)")
