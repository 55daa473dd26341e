"""Links and paths of the documents exist, commands and snippets run, and generated pages are current."""

from __future__ import annotations

import argparse
import importlib
import math
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from metric_cli.subcommands import parser_of
from tests.project.test_imports import PACKAGES

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (
    "crawler",
    "taxonomy",
    "metric_tree",
    "metric_base",
    "models3d",
    "estimator",
    "capture",
    "insertion",
    "metric_cli",
    "tests",
    "benchmarks",
    "data",
)
#: Files that a command creates at its first use, or that are only in the wheel.
CREATED = {"data/taxonomy/decisions/recorded.jsonl", "metric_tree/data"}
PAGES = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "data").glob("*.md"),
     *(path for folder in ("scenes", "models", "sources", "taxonomy", "curated")
       for path in (ROOT / "data" / folder).rglob("README.md"))]
)  # fmt: skip
CODE = sorted(path for package in (*PACKAGES, "benchmarks") for path in (ROOT / package).rglob("*.py"))
#: Documents and terms that are not part of the repository.
FOREIGN = re.compile(r"\b(methods|contracts|layout|style|peers|stack)\.md\b|\bthe issue(?!s)\b|\bthe contract\b")
#: Blocks of commands that are run unchanged in a folder with the repository's `data`.
CONSOLE = re.compile(r"^```console\n(.*?)^```", re.MULTILINE | re.DOTALL)
#: The same with the output that the page shows below it, if any.
SHOWN = re.compile(r"^```console\n(.*?)^```(?:\n```text\n(.*?)^```)?", re.MULTILINE | re.DOTALL)
#: A block of shell commands, and a line of it that begins with a program of the project.
SHELL = re.compile(r"^```(?:sh|console)\n(.*?)^```", re.MULTILINE | re.DOTALL)
PROGRAM = re.compile(r"(?:\$ )?(metric-tree|estimate-scale|insert-object) ")
#: Maximum relative difference between a number in the shown output and the same number today: the last digits depend
#: on the version of the linear algebra, and a reconstruction on the order of its threads.
MAX_SHOWN_DIFFERENCE = 0.03
#: Maximum number of words of the README.
MAX_README_WORDS = 900
PYTHON = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
#: Benchmarks in commands of documents and comments.
BENCHMARK = re.compile(r"python -m\s+(benchmarks(?:\.\w+)+)")
VARIABLE = re.compile(r"\bMETRIC_TREE_[A-Z_]+\b")


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_targets_of_local_links_exist(page: Path) -> None:
    targets = [link.partition("#")[0] for link in LINK.findall(page.read_text(encoding="utf-8"))]
    local = [target for target in targets if target and "://" not in target and not target.startswith("mailto:")]
    assert [target for target in local if not (page.parent / target).exists()] == []


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=_name)
def test_paths_in_a_page_exist(page: Path) -> None:
    named = re.findall(rf"`((?:{'|'.join(FOLDERS)})/[\w./-]+)`", page.read_text(encoding="utf-8"))
    assert [
        name
        for name in named
        if name not in CREATED and not any((folder / name).exists() for folder in (ROOT, page.parent))
    ] == []


@pytest.mark.parametrize("page", [page for page in PAGES if BENCHMARK.search(page.read_text("utf-8"))], ids=_name)
def test_benchmarks_in_a_page_can_be_imported(page: Path) -> None:
    """The commands that print the numbers of a document must exist."""
    for name in sorted(set(BENCHMARK.findall(page.read_text(encoding="utf-8")))):
        module = importlib.import_module(name)
        if hasattr(module, "__path__"):
            module = importlib.import_module(f"{name}.__main__")
        assert callable(module.main), name


def test_code_refers_only_to_existing_documents() -> None:
    wrong = {}
    for path in CODE:
        text = path.read_text(encoding="utf-8")
        missing = [name for name in re.findall(r"\bdocs/[\w/.-]+?\.md\b", text) if not (ROOT / name).is_file()]
        references = missing + [match.group() for match in FOREIGN.finditer(text)]
        if references:
            wrong[_name(path)] = references
    assert wrong == {}


def test_generated_pages_are_current() -> None:
    code = (
        "import sys; sys.path.insert(0, 'docs'); import generate\n"
        "for name, page in generate.PAGES.items():\n"
        "    if (generate.FOLDER / name).read_text(encoding='utf-8') != page(): print(name)"
    )
    stale = subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True).stdout
    assert stale == "", "run `make reference`"


def test_drawing_of_the_packages_is_current() -> None:
    code = (
        "import sys; sys.path.insert(0, 'docs'); import draw_architecture; print(draw_architecture.drawing(), end='')"
    )
    drawn = subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True).stdout
    assert drawn == (ROOT / "docs/images/architecture.svg").read_text(encoding="utf-8"), "run `make reference`"


def test_environment_page_lists_exactly_the_variables_of_the_code() -> None:
    used = {name for path in CODE for name in VARIABLE.findall(path.read_text(encoding="utf-8"))}
    page = (ROOT / "docs" / "reference" / "environment.md").read_text(encoding="utf-8")
    assert used - set(VARIABLE.findall(page)) == set()
    assert set(VARIABLE.findall(page)) - used == set()


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= MAX_README_WORDS


def test_the_navigation_has_every_page_once() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    listed = re.findall(r"[\w/-]+\.md", text)
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}
    assert sorted(listed) == sorted({*pages, "index.md"})


def _commands(block: str) -> list[str]:
    return [line[2:].partition("  #")[0] for line in block.splitlines() if line.startswith("$ ")]


def _options(words: list[str]) -> tuple[set[str], set[str]]:
    """Return the options of a command line of the project, and those that its parser has."""
    if words[0] == "metric-tree":
        parser = parser_of(words[1])
    else:
        module = {
            "estimate-scale": "metric_cli.estimate_scale.parser",
            "insert-object": "metric_cli.insert_object.parser",
        }
        parser = importlib.import_module(module[words[0]]).parser()
    actions = list(parser._actions)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            actions += [nested for choice in action.choices.values() for nested in choice._actions]
    known = {option for action in actions for option in action.option_strings}
    return {word.partition("=")[0] for word in words[1:] if word.startswith("--")}, known


@pytest.mark.parametrize("page", [page for page in PAGES if SHELL.search(page.read_text(encoding="utf-8"))], ids=_name)
def test_options_of_commands_exist(page: Path) -> None:
    for block in SHELL.findall(page.read_text(encoding="utf-8")):
        for line in block.replace("\\\n", " ").splitlines():
            if PROGRAM.match(line):
                used, known = _options(shlex.split(line.removeprefix("$ "), comments=True))
                assert used - known == set(), line


def _agrees(shown: str, printed: str) -> bool:
    """Return True if two lines have the same words, numbers within `MAX_SHOWN_DIFFERENCE`, integers within 1."""
    number = re.compile(r"\d+(?:\.\d+)?")
    if number.sub("0", shown).split() != number.sub("0", printed).split():
        return False
    pairs = zip(number.findall(shown), number.findall(printed), strict=True)
    return all(
        math.isclose(float(a), float(b), rel_tol=MAX_SHOWN_DIFFERENCE, abs_tol=0.011 if "." in a else 1.0)
        for a, b in pairs
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in PAGES if CONSOLE.search(page.read_text(encoding="utf-8"))], ids=_name
)
def test_commands_of_a_page_end_with_status_zero_and_print_the_shown_lines(page: Path, tmp_path: Path) -> None:
    """The commands after `$ ` run in one folder, in order."""
    (tmp_path / "data").symlink_to(ROOT / "data")
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
    }
    for block, shown in SHOWN.findall(page.read_text(encoding="utf-8")):
        printed = ""
        for line in _commands(block):
            done = subprocess.run(
                ["bash", "-c", line], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
            printed += done.stdout
        for line in shown.splitlines():
            if line.strip(" ─.") and "─" not in line:
                assert any(_agrees(line, other) for other in printed.splitlines()), f"{line}\n{printed}"


@pytest.mark.parametrize("page", [page for page in PAGES if PYTHON.search(page.read_text(encoding="utf-8"))], ids=_name)
def test_python_snippets_of_a_page_run(page: Path, tmp_path: Path) -> None:
    """The Python blocks of a page run in one process, in order."""
    (tmp_path / "data").symlink_to(ROOT / "data")
    code = "\n".join(PYTHON.findall(page.read_text(encoding="utf-8")))
    if page.name == "api.md":  # signatures, not programs
        return
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{code}\n{done.stderr}"
