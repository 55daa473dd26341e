"""Options that messages and pages name are there: in a parser, with a value where one is named."""

from __future__ import annotations

import argparse
import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from metric_cli.parser import arguments_of
from tests.metric_cli.test_paths import PARSERS

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    "metric_base",
    "crawler",
    "taxonomy",
    "metric_tree",
    "models3d",
    "estimator",
    "capture",
    "insertion",
    "explorer",
    "metric_cli",
)
#: Options of other programs, of an example of a misspelling, and half of a pattern.
OTHERS = {"--background", "--factory-startup", "--python", "--workspace", "--instnces", "--ade"}
#: Scripts that another program runs, with separate options.
SCRIPTS = {"layer_script.py"}
NAMED = re.compile(r"(?<![\w-])(--[a-z][a-z-]+[a-z])(?: ([A-Z]{2,}))?")
#: A subcommand before its option: `build --include-withheld`, `metric-tree review record ... --why`.
OF_SUBCOMMAND = re.compile(
    rf"\b({'|'.join(name.split()[-1] for name in PARSERS if ' ' in name)}) (--[a-z][a-z-]+[a-z])"
)
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])


def _actions() -> dict[str, list[argparse.Action]]:
    table: dict[str, list[argparse.Action]] = {}
    for parser in PARSERS.values():
        for action in arguments_of(parser):
            for option in action.option_strings:
                table.setdefault(option, []).append(action)
    return table


def _options(command: str) -> set[str]:
    return {option for action in arguments_of(PARSERS[command]) for option in action.option_strings}


def _texts() -> Iterator[tuple[str, str]]:
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            nodes = ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if file.name not in SCRIPTS else ()
            for node in nodes:
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield str(file.relative_to(ROOT)), node.value


def test_options_that_messages_name_are_there() -> None:
    actions, wrong = _actions(), []
    for file, text in _texts():
        for option, value in NAMED.findall(text):
            known = actions.get(option, [])
            if option not in OTHERS and not any(not value or action.nargs != 0 for action in known):
                wrong.append((file, option, value))
        for subcommand, option in OF_SUBCOMMAND.findall(text):
            if not any(name.split()[-1] == subcommand and option in _options(name) for name in PARSERS):
                wrong.append((file, subcommand, option))
    assert wrong == []


def _command_of(words: list[str]) -> str | None:
    """The longest command that the words begin with."""
    known = (" ".join(words[:count]) for count in (3, 2, 1))
    return next((name for name in known if name in PARSERS), None)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_of_a_page_name_options_that_are_there(page: Path) -> None:
    wrong = []
    for block in re.findall(r"^```[a-z]*\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            if not re.match(r"(\$ )?(metric-tree|estimate-scale|insert-object) ", line):
                continue
            words = shlex.split(line.removeprefix("$ ").partition("  #")[0].replace("'", "").replace('"', ""))
            command = _command_of(words)
            wrong += [(line, word) for word in words if command and NAMED.fullmatch(word.partition("=")[0])
                      and word.partition("=")[0] not in _options(command)]  # fmt: skip
    assert wrong == []
