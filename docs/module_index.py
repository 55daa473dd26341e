"""Write the index of modules, limits and tests into the `__init__.py` of the packages: `make reference`.

`tests/project/test_module_index.py` fails if an index lacks a module or a limit, or names one that does not exist.
"""

from __future__ import annotations

import ast
import os
import re
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("estimator", "capture", "models3d")
TITLE = "# Modules, their limits, and their tests in"
#: A named number with a unit or a limit.
_LIMIT = re.compile(r"[A-Z][A-Z0-9_]+")
_WIDTH = 120


def indexes() -> dict[Path, str]:
    """Return the index of each `__init__.py` of the packages, as lines of comments."""
    folders = sorted({file.parent for name in PACKAGES for file in (ROOT / name).rglob("*.py")})
    return {folder / "__init__.py": index for folder in folders if (index := _index(folder))}


def without_index(text: str) -> str:
    """Return the text of a module without its index, which is at the end."""
    return text.partition(f"\n{TITLE}")[0].rstrip("\n") + "\n"


def _index(folder: Path) -> str:
    modules = [file for file in sorted(folder.glob("*.py")) if file.name != "__init__.py"]
    tests = ROOT / "tests" / folder.relative_to(ROOT)
    tests = tests if any(tests.glob("test_*.py")) else tests.parent
    lines = [f"{TITLE} `{tests.relative_to(ROOT).as_posix()}`:"]
    for module in modules:
        tree = ast.parse(module.read_text(encoding="utf-8"))
        summary = (ast.get_docstring(tree) or "").split("\n\n")[0].replace("\n", " ")
        entry = f"- {module.stem}: {summary}"
        if limits := _limits(tree):
            entry += f" Limits: {', '.join(limits)}."
        if names := _tests_of(module, tests):
            entry += f" Tests: {', '.join(names)}."
        lines += textwrap.wrap(
            entry, _WIDTH, initial_indent="# ", subsequent_indent="#   ", break_long_words=False, break_on_hyphens=False
        )
    return "\n".join(lines) + "\n" if len(lines) > 1 else ""


def _limits(tree: ast.Module) -> list[str]:
    """Return the names of the public constants of a module that are numbers, in their order."""
    names: list[str] = []
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            parts = [
                part for target in targets for part in (target.elts if isinstance(target, ast.Tuple) else [target])
            ]
            is_numeric = all(
                isinstance(
                    part, ast.Constant | ast.UnaryOp | ast.BinOp | ast.operator | ast.unaryop | ast.Tuple | ast.Load
                )
                and not (isinstance(part, ast.Constant) and not isinstance(part.value, int | float))
                for part in ast.walk(node.value)
            )
            if is_numeric:
                names += [part.id for part in parts if isinstance(part, ast.Name) and _LIMIT.fullmatch(part.id)]
    return names


def _tests_of(module: Path, folder: Path) -> list[str]:
    """Return the test files in a folder that import a module or have its name; if none do, those of its package."""
    name = ".".join(module.relative_to(ROOT).with_suffix("").parts)
    package, _, stem = name.rpartition(".")
    imported = re.compile(rf"\b{re.escape(name)}\b|from {re.escape(package)} import (?:\([^)]*|[^\n(]*)\b{stem}\b")
    elsewhere = [file for file in (ROOT / "tests" / name.partition(".")[0]).rglob("test_*.py") if file.parent != folder]
    for files in (folder.glob("test_*.py"), elsewhere):
        found = [
            os.path.relpath(file, folder)
            for file in sorted(files)
            if file.stem.startswith(f"test_{stem}") or imported.search(file.read_text(encoding="utf-8"))
        ]
        if found:
            return found
    return []


def main() -> None:
    """Write the indexes."""
    for file, index in indexes().items():
        file.write_text(f"{without_index(file.read_text(encoding='utf-8'))}\n{index}", encoding="utf-8")


if __name__ == "__main__":
    main()
