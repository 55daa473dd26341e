"""Writes the parts of the reference that the code knows: `make reference`.

`commands.md` comes from `--help`, `checks.md` from the codes of `metric-tree validate`, `api.md` from docstrings.
`tests/project/test_docs.py` fails if a file differs from what the code says.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import inspect
import os
import re
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parent / "reference"
#: Columns of a help text: what fits on a page.
WIDTH = "100"
#: Options that the first lines of the page of commands describe for all commands, with their texts in `--help`.
COMMON_OPTIONS = {
    "--json": "print the result as JSON",
    "--overwrite": "replace existing files",
    "--tree": "release: version or folder (default: shipped)",
    "--completion": "print the completion script of a shell",
    "--version": "print the versions of program and data, and exit",
    "--jobs": "with --batch: processes (default: one per core)",
    "--part": "with --batch: part I of N, for Slurm arrays",
}
NOTE = "<!-- Written by `make reference`. Do not edit. -->"
COMMANDS_INTRO = """\
Every command takes `--help` and `--json`. Results go to standard output, all else to standard error. Options that have
the same meaning in several commands are not repeated below: `--tree REF` (version or folder of a release; default: the
shipped one), `--overwrite` (replace existing files), with `--batch` also `--jobs N` (processes; default: one per core)
and `--part I/N` (part I of N, for Slurm arrays), and of the programs `--version` (of program and data) and
`--completion SHELL`."""
#: Commands: the program, and where its parser comes from.
PROGRAMS = {"estimate-scale": "metric_cli.estimate_scale.parser", "insert-object": "metric_cli.insert_object.parser"}
APIS = ("metric_tree", "estimator", "capture", "models3d", "insertion")
#: Classes for programs that read or write glTF files themselves: only the code documents more than their purpose.
SUMMARIES = {"GltfDocument", "GltfWriter"}
#: Methods that are not listed: those of a tree that its nodes have too, rows of tables, and deprecated names.
OMITTED = {
    "Prior.of_row", "Prior.row", "ScaleResult.record", "Tree.children", "Tree.prior", "Tree.prior_dims", "Tree.tier",
}  # fmt: skip


def commands() -> str:
    """`reference/commands.md`: the help of every command and subcommand."""
    os.environ["COLUMNS"] = WIDTH
    parts = [f"# Commands\n\n{NOTE}\n\n{COMMANDS_INTRO}"]
    for program, module in PROGRAMS.items():
        if importlib.util.find_spec(module.partition(".")[0]) is not None:
            parts.append(_help(program, importlib.import_module(module).parser()))
    from metric_cli.subcommands import SUBCOMMANDS, parser_of

    parts += [_help(f"metric-tree {subcommand}", parser_of(subcommand)) for subcommand in SUBCOMMANDS]
    return "\n\n".join(parts) + "\n"


def _help(program: str, parser: argparse.ArgumentParser) -> str:
    """Return the section of a command without the options that the first lines of the page state for all commands.

    A usage line without a text of its own names only what is required: the list of options follows it anyway.
    """
    for action in parser._actions:
        name = action.option_strings[-1] if action.option_strings else ""
        if isinstance(action, argparse._HelpAction) or action.help == COMMON_OPTIONS.get(name, ...):
            action.help = argparse.SUPPRESS
    if parser.usage is None:
        required = [action for action in parser._actions if action.required and action.option_strings]
        names = [f"{action.option_strings[0]} {action.metavar or action.dest.upper()}" for action in required]
        positionals = " ".join(
            parser._get_formatter()._format_args(action, action.metavar or action.dest)
            for action in parser._get_positional_actions()
        )
        parser.usage = " ".join(part for part in (parser.prog, positionals, *names, "[OPTION ...]") if part)
    text = "\n".join(line.rstrip() for line in parser.format_help().strip().splitlines())
    return f"## {program}\n\n```text\n{text}\n```"


def checks() -> str:
    """`reference/checks.md`: the codes of `metric-tree validate`."""
    from metric_tree.checks.release_files import CODES

    rows = "\n".join(f"| {code} | {meaning} |" for code, meaning in sorted(CODES.items()))
    return (
        f"# Validation codes\n\n{NOTE}\n\n`metric-tree validate` reports what it finds with these codes. "
        f"E is an error (exit status 2), W a warning.\n\n| code | meaning |\n|---|---|\n{rows}\n"
    )


def api() -> str:
    """`reference/api.md`: the public names of the packages with their docstrings."""
    units = "Lengths in the tree are millimetres; lengths in a scene are in the unit of the scene."
    units += " Functions that read input raise `InputError` with one line: file, field, expected and found value."
    units += " Other errors are listed; examples are in the docstrings (`help(name)`)."
    parts = [f"# Python API\n\n{NOTE}\n\n{units}"]
    for package in APIS:
        module = importlib.import_module(package)
        text = re.sub(r"^>>> .*?(?:\n\n|\Z)", "", inspect.getdoc(module) or "", flags=re.MULTILINE | re.DOTALL)
        parts.append(f"## {package}\n\n{text.strip()}")
        parts += [_entry(package, name, getattr(module, name)) for name in getattr(module, "__all__", ())]
    return "\n\n".join(parts) + "\n"


def _entry(package: str, name: str, value: Any) -> str:
    title = f"### `{package}.{name}`"
    if inspect.isclass(value):
        if name in SUMMARIES:
            return f"{title}\n\n{_text(value).splitlines()[0]}"
        members = "\n\n".join(_members(name, value))
        return f"{title}\n\n{_text(value)}" + (f"\n\n{members}" if members else "")
    return f"{title}\n\n    {name}{_signature(value)}\n\n{_text(value)}"


def _members(owner: str, value: type) -> Iterator[str]:
    """Yield the public methods and properties that are not `OMITTED`."""
    for name, member in vars(value).items():
        target = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
        if name.startswith("_") or not callable(target) or inspect.getdoc(target) is None:
            continue
        if f"{owner}.{name}" in OMITTED:
            continue
        shape = "" if isinstance(member, property) else _signature(target)
        yield f"#### `{owner}.{name}{shape}`\n\n{_text(target)}"


def _signature(function: Callable[..., Any]) -> str:
    """Return the parameters; without types if the docstring, which is shown below them, lists them with types."""
    try:
        signature = inspect.signature(function)
        if "Parameters\n---" in (inspect.getdoc(function) or ""):
            plain = [item.replace(annotation=inspect.Parameter.empty) for item in signature.parameters.values()]
            signature = signature.replace(parameters=plain)
        text = str(signature).replace("'", "")
        return re.sub(r"<function (\w+) at 0x\w+>", r"\1", text)
    except (TypeError, ValueError):
        return "(...)"


def _text(value: object) -> str:
    """Return the docstring without examples, without `InputError` and without the lines below titles of sections."""
    text = re.split(r"\n+(?:Examples\n-+\n)?>>> ", inspect.getdoc(value) or "", maxsplit=1)[0]
    text = re.sub(r"^InputError\n(?: +.*\n?)+", "", text, flags=re.MULTILINE)
    text = re.sub(r"\n*^Raises\n-+\n(?=\n|\Z)", "", text, flags=re.MULTILINE)
    head, line, rest = text.partition("\n\n")
    rest = re.sub(r"^(\w+)\n-+$", r"\1:", rest, flags=re.MULTILINE)
    return f"{head}\n\n{textwrap.indent(rest, '    ')}" if line else head


def image_credits() -> str:
    """`data/CREDITS.md`: the authors of the images of the shipped release."""
    import metric_tree

    rows = metric_tree.open().release.table("images").select(["attribution", "licence"]).to_pylist()
    credits_ = sorted({(row["attribution"] or "see the source", row["licence"]) for row in rows})
    lines = "\n".join(f"- {attribution} ({licence})" for attribution, licence in credits_)
    intro = "The images of the shipped release are rendered from these models."
    return f"# Credits of the images\n\n{NOTE}\n\n{intro}\n\n{lines}\n"


#: Page, relative to `docs/reference`, to the function that writes it.
PAGES = {"commands.md": commands, "checks.md": checks, "api.md": api, "../../data/CREDITS.md": image_credits}


def main(folder: Path = FOLDER) -> None:
    """Write all pages into a folder."""
    for name, page in PAGES.items():
        (folder / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
