"""Documents say what is true: links lead somewhere, commands and snippets run, generated pages are current."""

from __future__ import annotations

import importlib
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.project.test_imports import PACKAGES

ROOT = Path(__file__).resolve().parents[2]
ROOMS = (
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
#: What a command writes when it is first used.
WRITTEN = {"data/taxonomy/decisions/recorded.jsonl"}
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
CODE = sorted(path for package in (*PACKAGES, "benchmarks") for path in (ROOT / package).rglob("*.py"))
#: Documents of others, and words for what only those who wrote the code have seen.
FOREIGN = re.compile(r"\b(methods|contracts|layout|style|peers|stack)\.md\b|\bthe issue(?!s)\b|\bthe contract\b")
#: A block of commands that are run as they are written, in a folder that holds the repository's `data`.
CONSOLE = re.compile(r"^```console\n(.*?)^```", re.MULTILINE | re.DOTALL)
PYTHON = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
#: A benchmark that a document or a comment names as a command.
BENCHMARK = re.compile(r"python -m\s+(benchmarks(?:\.\w+)+)")
VARIABLE = re.compile(r"\bMETRIC_TREE_[A-Z_]+\b")


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_links_lead_to_files(page: Path) -> None:
    targets = [link.partition("#")[0] for link in LINK.findall(page.read_text(encoding="utf-8"))]
    local = [target for target in targets if target and "://" not in target and not target.startswith("mailto:")]
    assert [target for target in local if not (page.parent / target).exists()] == []


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=_name)
def test_files_that_a_page_names_are_there(page: Path) -> None:
    named = re.findall(rf"`((?:{'|'.join(ROOMS)})/[\w./-]+)`", page.read_text(encoding="utf-8"))
    assert [name for name in named if name not in WRITTEN and not (ROOT / name).exists()] == []


@pytest.mark.parametrize("page", [page for page in PAGES if BENCHMARK.search(page.read_text("utf-8"))], ids=_name)
def test_benchmarks_that_a_page_names_import(page: Path) -> None:
    """Every number in a document keeps its command."""
    for name in sorted(set(BENCHMARK.findall(page.read_text(encoding="utf-8")))):
        module = importlib.import_module(name)
        if hasattr(module, "__path__"):
            module = importlib.import_module(f"{name}.__main__")
        assert callable(module.main), name


def test_code_cites_only_documents_that_are_here() -> None:
    cited = {}
    for path in CODE:
        text = path.read_text(encoding="utf-8")
        gone = [name for name in re.findall(r"\bdocs/[\w/.-]+?\.md\b", text) if not (ROOT / name).is_file()]
        bad = gone + [match.group() for match in FOREIGN.finditer(text)]
        if bad:
            cited[_name(path)] = bad
    assert cited == {}


def test_generated_pages_are_current() -> None:
    code = (
        "import sys; sys.path.insert(0, 'docs'); import generate\n"
        "for name, page in generate.PAGES.items():\n"
        "    if (generate.FOLDER / name).read_text(encoding='utf-8') != page(): print(name)"
    )
    stale = subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True).stdout
    assert stale == "", "run `make reference`"


def test_the_drawing_of_the_packages_is_current() -> None:
    code = (
        "import sys; sys.path.insert(0, 'docs'); import draw_architecture; print(draw_architecture.drawing(), end='')"
    )
    drawn = subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True).stdout
    assert drawn == (ROOT / "docs/images/architecture.svg").read_text(encoding="utf-8"), "run `make reference`"


def test_every_environment_variable_is_documented() -> None:
    used = {name for path in CODE for name in VARIABLE.findall(path.read_text(encoding="utf-8"))}
    page = (ROOT / "docs" / "reference" / "environment.md").read_text(encoding="utf-8")
    assert used - set(VARIABLE.findall(page)) == set()
    assert set(VARIABLE.findall(page)) - used == set()


def _commands(block: str) -> list[str]:
    return [line[2:].partition("  #")[0] for line in block.splitlines() if line.startswith("$ ")]


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in PAGES if CONSOLE.search(page.read_text(encoding="utf-8"))], ids=_name
)
def test_commands_run_as_written(page: Path, tmp_path: Path) -> None:
    """Each line that begins with `$ ` ends with status 0; a page's commands run in one folder, in order."""
    (tmp_path / "data").symlink_to(ROOT / "data")
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
    }
    for block in CONSOLE.findall(page.read_text(encoding="utf-8")):
        for line in _commands(block):
            done = subprocess.run(
                ["bash", "-c", line], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
            assert shlex.split(line, comments=True)


@pytest.mark.parametrize("page", [page for page in PAGES if PYTHON.search(page.read_text(encoding="utf-8"))], ids=_name)
def test_snippets_run_as_written(page: Path, tmp_path: Path) -> None:
    """The Python blocks of a page run one after the other in one process."""
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
