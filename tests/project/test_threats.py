"""The code does not execute input files (docs/explanation/threat-model.md)."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = [path.parent for path in sorted(ROOT.glob("*/py.typed"))]
#: Modules that unpickle files which the same build wrote to its work folder.
MAY_UNPICKLE = {"metric_tree/pipeline/work_folder.py", "metric_tree/pipeline/clean.py"}
RUNS_CODE = {"eval", "exec", "compile", "__import__"}
UNPICKLES = {
    ("pickle", "load"),
    ("pickle", "loads"),
    ("np", "load"),
    ("numpy", "load"),
    ("yaml", "load"),
    ("joblib", "load"),
}


def _calls(path: Path) -> list[ast.Call]:
    return [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]


def _is_safe_load(call: ast.Call) -> bool:
    return any(
        keyword.arg == "allow_pickle" and isinstance(keyword.value, ast.Constant) and keyword.value.value is False
        for keyword in call.keywords
    )


def _error(call: ast.Call) -> str | None:
    """Return the forbidden function or argument of a call, or None."""
    function = call.func
    if isinstance(function, ast.Name) and function.id in RUNS_CODE:
        return function.id
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
        name = (function.value.id, function.attr)
        if name in UNPICKLES and not _is_safe_load(call):
            return ".".join(name)
    if any(keyword.arg == "shell" and getattr(keyword.value, "value", None) is True for keyword in call.keywords):
        return "shell=True"
    return None


def test_packages_do_not_execute_input_files() -> None:
    errors = {}
    for package in PACKAGES:
        for path in package.rglob("*.py"):
            name = path.relative_to(ROOT).as_posix()
            found = [error for call in _calls(path) if (error := _error(call))]
            if found and name not in MAY_UNPICKLE:
                errors[name] = found
    assert errors == {}


def test_check_finds_forbidden_calls_and_accepts_safe_ones() -> None:
    def error(code: str) -> str | None:
        node = ast.parse(code, mode="eval").body
        assert isinstance(node, ast.Call)
        return _error(node)

    assert error("eval(x)") == "eval"
    assert error("np.load(x)") == "np.load"
    assert error("np.load(x, allow_pickle=False)") is None
    assert error("run(x, shell=True)") == "shell=True"
