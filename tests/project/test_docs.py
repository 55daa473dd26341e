"""Links, paths and options of the documents exist, Python snippets run, and generated pages are current."""

from __future__ import annotations

import argparse
import importlib
import re
import shlex
import subprocess
import sys
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

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
#: A block of shell commands, and a line of it that begins with a program of the project.
SHELL = re.compile(r"^```(?:sh|console)\n(.*?)^```", re.MULTILINE | re.DOTALL)
PROGRAM = re.compile(r"(?:\$ )?(metric-tree|estimate-scale|insert-object) ")
#: Questions of new users, with the pages that answer them and a part of the answer.
QUESTIONS: list[dict[str, Any]] = tomllib.loads(Path(__file__).with_name("newcomers.toml").read_text("utf-8"))[
    "question"
]
#: Maximum number of pages, and of words in them, that a new user reads until a question is answered.
MAX_PAGES, MAX_ANSWER_WORDS = 2, 1500
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


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=_name)
def test_constants_in_a_page_exist(page: Path) -> None:
    named = re.findall(r"`([A-Z][A-Z0-9]*_[A-Z0-9_]+)`", page.read_text(encoding="utf-8"))
    assert [name for name in named if name not in _words_of_the_code()] == []


@cache
def _words_of_the_code() -> frozenset[str]:
    return frozenset(re.findall(r"\b[A-Z][A-Z0-9_]{2,}\b", "\n".join(path.read_text("utf-8") for path in CODE)))


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
    stale = subprocess.run(
        [sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True, timeout=300
    ).stdout
    assert stale == "", "run `make reference`"


def test_drawing_of_the_packages_is_current() -> None:
    code = (
        "import sys; sys.path.insert(0, 'docs'); import draw_architecture; print(draw_architecture.drawing(), end='')"
    )
    drawn = subprocess.run(
        [sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True, timeout=300
    ).stdout
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


@pytest.mark.parametrize("page", [page for page in PAGES if PYTHON.search(page.read_text(encoding="utf-8"))], ids=_name)
def test_python_snippets_of_a_page_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The Python blocks of a page run in order."""
    (tmp_path / "data").symlink_to(ROOT / "data")
    code = "\n".join(PYTHON.findall(page.read_text(encoding="utf-8")))
    if page.name == "api.md":  # signatures, not programs
        return
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(page), "exec"), {"__name__": "__main__"})


def _section(page: str) -> str:
    """Return a page, or the section `page#anchor` with the sections below it."""
    name, _, anchor = page.partition("#")
    text = (ROOT / name).read_text(encoding="utf-8")
    if not anchor:
        return text
    parts = re.split(r"^(#+) (.*)$", text, flags=re.MULTILINE)
    headings = list(zip(parts[1::3], parts[2::3], parts[3::3], strict=True))
    start = next(k for k, (_, title, _) in enumerate(headings) if _anchor(title) == anchor)
    end = start + 1
    while end < len(headings) and len(headings[end][0]) > len(headings[start][0]):
        end += 1
    return "".join(f"{marks} {title}{body}" for marks, title, body in headings[start:end])


def _anchor(title: str) -> str:
    return re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda question: question["text"][:40])
def test_a_question_of_a_newcomer_is_answered_within_two_pages(question: dict[str, Any]) -> None:
    texts = [_section(page) for page in question["pages"]]
    assert len(texts) <= MAX_PAGES
    assert sum(len(text.split()) for text in texts) <= MAX_ANSWER_WORDS
    assert any(question["answer"] in text for text in texts)


def test_each_kind_of_user_has_ten_questions() -> None:
    assert set(Counter(question["user"] for question in QUESTIONS).values()) == {10}
