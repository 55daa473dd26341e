"""Docstrings of functions with array parameters or results state the shapes, also for private functions."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("crawler", "taxonomy", "metric_tree", "metric_base", "models3d", "estimator", "capture", "insertion")

#: Annotations of arrays.
ARRAY = re.compile(r"\b(NDArray|Arrays|ndarray|(Float|Int|Bool)Array|FloatImage|GreyPicture|Linear|Grey|RGB)\b")
#: One side of a shape: `n`, `3`, `H'`, `...`, `pieces + 1`, `3 or 4`, `PARAMETERS`.
_SIDE = r"(\.\.\.|[A-Za-z]'?|\d+( or \d+)?|[A-Z]{2,}|(\d )?\(?\w+ [+-] \d+\)?|\d \w|\d?[a-z])"
#: `(n, 3)`, `(h, w)`, `(3,)`, `(k, 3, 3)`; or words for arbitrary shapes.
SHAPE = re.compile(rf"\({_SIDE},( {_SIDE},?)*\)|\bscalars?\b|\bany shape\b|\bsame shape\b")


def array_functions() -> Iterator[tuple[str, str, str]]:
    """Yield (location, name, docstring) of the public and private functions with array annotations."""
    for file, tree in _trees().items():
        yield from _functions(file, tree)


@cache
def _trees() -> dict[Path, ast.Module]:
    files = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
    return {file: ast.parse(file.read_text(encoding="utf-8")) for file in files}


def _functions(file: Path, body: ast.Module | ast.ClassDef) -> Iterator[tuple[str, str, str]]:
    """Yield the functions of a module or a class, without nested functions."""
    for node in body.body:
        if isinstance(node, ast.ClassDef):
            yield from _functions(file, node)
        elif isinstance(node, ast.FunctionDef):
            arguments = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
            notes = [note for note in (node.returns, *(argument.annotation for argument in arguments)) if note]
            if any(ARRAY.search(ast.unparse(note)) for note in notes):
                documented = body if node.name == "__init__" else node
                yield f"{file.relative_to(ROOT)}:{node.lineno}", node.name, ast.get_docstring(documented) or ""


def test_docstrings_state_the_shapes_of_arrays() -> None:
    functions = list(array_functions())
    assert sum(name.startswith("_") for _, name, _ in functions) > 100
    assert [f"{location} {name}" for location, name, text in functions if not SHAPE.search(text)] == []
