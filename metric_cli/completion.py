"""Completion scripts for shells, made from the programs' own options and verbs."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from typing import Any, NoReturn

__all__ = ["SHELLS", "PrintCompletion", "completion_script", "option_helps"]

SHELLS = ("bash", "zsh", "fish")


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


def completion_script(program: str, verbs: Mapping[str, Mapping[str, str]], shell: str) -> str:
    """What to source so that a shell completes verbs and options of a program, and files elsewhere.

    verbs : help by option, by verb; the options of a program without verbs are those of the verb `""`.
    """
    if shell == "fish":
        return "".join(_fish_lines(program, verb, options) for verb, options in verbs.items())
    names = " ".join(verb for verb in verbs if verb)
    cases = "".join(f'        "{verb}") words="{" ".join(options)}" ;;\n' for verb, options in verbs.items() if verb)
    function = f"_{program.replace('-', '_')}"
    choice = f'    case "${{COMP_WORDS[1]}}" in\n{cases}    esac\n' if names else ""
    first = f'    if [[ $COMP_CWORD -eq 1 ]]; then words="{names} $words"; fi\n' if names else ""
    listed = '"$word" == -* || $COMP_CWORD -eq 1' if names else '"$word" == -*'
    bash = f"""{function}() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" words="{" ".join(verbs.get("", {}))}"
{choice}{first}    if [[ {listed} ]]; then
        COMPREPLY=($(compgen -W "$words" -- "$word"))
    else
        COMPREPLY=($(compgen -f -- "$word"))
    fi
}}
complete -o filenames -F {function} {program}
"""
    return bash if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{bash}"


def _fish_lines(program: str, verb: str, options: Mapping[str, str]) -> str:
    named = f"complete -c {program} -n __fish_use_subcommand -a {verb}\n" if verb else ""
    where = f" -n '__fish_seen_subcommand_from {verb}'" if verb else ""
    lines = (f"complete -c {program}{where} -l {name[2:]} -d '{_quoted(text)}'\n" for name, text in options.items())
    return named + "".join(lines)


def _quoted(text: str) -> str:
    """Text between single quotes of fish; argparse's own %s are not for a shell."""
    return text.replace("%(default)s", "see --help").replace("\\", "\\\\").replace("'", "\\'")
