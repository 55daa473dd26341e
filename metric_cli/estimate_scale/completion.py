"""Completion scripts for shells, made from a command's own options."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["SHELLS", "completion_script"]

SHELLS = ("bash", "zsh", "fish")


def completion_script(program: str, options: Mapping[str, str], shell: str) -> str:
    """What to source so that a shell completes the options of a program, and files where an option is not begun.

    options : help by option; shell : one of SHELLS.
    """
    names = sorted(name for name in options if name.startswith("--"))
    if shell == "fish":
        lines = [f"complete -c {program} -l {name[2:]} -d '{_quote(options[name])}'" for name in names]
        return "\n".join(lines) + "\n"
    function = f"_{program.replace('-', '_')}"
    bash = f"""{function}() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}"
    if [[ "$word" == -* ]]; then
        COMPREPLY=($(compgen -W "{" ".join(names)}" -- "$word"))
    else
        COMPREPLY=($(compgen -f -- "$word"))
    fi
}}
complete -o filenames -F {function} {program}
"""
    return bash if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{bash}"


def _quote(text: str) -> str:
    """Text between single quotes of fish; argparse's own %s are not for a shell."""
    return text.replace("%(default)s", "see --help").replace("\\", "\\\\").replace("'", "\\'")
