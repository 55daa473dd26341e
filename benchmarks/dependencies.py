"""What each dependency costs and where it is used, for `docs/explanation/dependencies.md`.

    python -m benchmarks.dependencies [--pages DIR]

Megabytes are those of the package's own files. Seconds are of processor, the least of three: the statement by which
ours import it most often, in a new process, less Python's start. The last column counts the modules that import it.
With `--pages` the parsers that were compared for reading pages take each `*.html.gz` of a folder.
"""

from __future__ import annotations

import argparse
import ast
import gzip
import os
import re
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable
from importlib.metadata import distribution, packages_distributions
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
#: Distributions whose modules are several; the one that ours import.
MODULES = {"usd-core": "pxr", "distributed": "distributed", "nltk": "nltk"}


def main() -> int:
    """Print one row for each dependency, or for each parser."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pages", type=Path, metavar="DIR")
    pages = parser.parse_args().pages
    return parsers(pages) if pages else costs()


def parsers(folder: Path) -> int:
    """Print what parsing a page costs with each parser, in milliseconds of processor in the mean."""
    from bs4 import BeautifulSoup
    from lxml import html

    pages = [gzip.decompress(path.read_bytes()) for path in sorted(folder.glob("*.html.gz"))]
    ways: dict[str, Callable[[bytes], object]] = {
        "beautifulsoup4, html.parser": lambda page: BeautifulSoup(page, "html.parser"),
        "beautifulsoup4, lxml": lambda page: BeautifulSoup(page, "lxml"),
        "lxml": html.document_fromstring,
    }
    print("| parser | ms a page |\n|---|---:|")
    for name, parse in ways.items():
        start = time.process_time()
        for page in pages:
            parse(page)
        print(f"| {name} | {(time.process_time() - start) / len(pages) * 1e3:.0f} |")
    return 0


def costs() -> int:
    """Print one row for each dependency."""
    uses = imports()
    bare = seconds("pass")
    print("| package | extra | MB | import, s | modules |\n|---|---|---:|---:|---:|")
    for name, extras in sorted(dependencies().items()):
        module = MODULES.get(name) or module_of(name)
        own = uses.get(module, {})
        statements = Counter(statement for found in own.values() for statement in found)
        usual = max(statements, key=lambda one: statements[one], default=f"import {module}")
        cost = max(seconds(usual) - bare, 0.0)
        print(f"| {name} | {', '.join(extras)} | {megabytes(name):.1f} | {cost:.2f} | {len(own)} |", flush=True)
    return 0


def dependencies() -> dict[str, list[str]]:
    """The extras of each distribution that `pyproject.toml` names; those of every install are `base`."""
    found: dict[str, list[str]] = {}
    groups = {"base": PROJECT["project"]["dependencies"], **PROJECT["project"]["optional-dependencies"]}
    for extra, lines in groups.items():
        for line in lines:
            name = re.match(r"[\w.-]+", line)[0].lower()  # type: ignore[index]
            if name != "metric-tree":
                found.setdefault(name, []).append(extra)
    return found


def module_of(name: str) -> str:
    """The module that a distribution is imported by: the one that most of its files are in."""
    homes = [module for module, owners in packages_distributions().items() if name in map(normal, owners)]
    files = Counter(file.parts[0].removesuffix(".py") for file in distribution(name).files or ())
    return max((home for home in homes if home.isidentifier()), key=lambda home: files[home])


def normal(name: str) -> str:
    """A distribution's name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def megabytes(name: str) -> float:
    """The size of a distribution's own files."""
    return sum(file.size or 0 for file in distribution(name).files or ()) / 1e6


def seconds(code: str) -> float:
    """The least of three processor times of a new Python process that runs the code."""
    times = []
    for _ in range(3):
        start = os.times()
        subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
        end = os.times()
        times.append(end.children_user - start.children_user + end.children_system - start.children_system)
    return min(times)


def imports() -> dict[str, dict[Path, set[str]]]:
    """The import statements of our modules by top-level name and file."""
    found: dict[str, dict[Path, set[str]]] = {}
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in filter(None, names):
                found.setdefault(name.partition(".")[0], {}).setdefault(path, set()).add(ast.unparse(node))
    return found


if __name__ == "__main__":
    raise SystemExit(main())
