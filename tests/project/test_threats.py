"""What the code never does with a file of a stranger (docs/explanation/threat-model.md)."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = [path.parent for path in sorted(ROOT.glob("*/py.typed"))]
#: What a build wrote itself, in its own process or its own work folder.
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
    words = {word.arg: word.value for word in call.keywords}
    return any(
        isinstance(value, ast.Constant) and value.value is False
        for name, value in words.items()
        if name == "allow_pickle"
    )


def _errors(call: ast.Call) -> str | None:
    function = call.func
    if isinstance(function, ast.Name) and function.id in RUNS_CODE:
        return function.id
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
        name = (function.value.id, function.attr)
        if name in UNPICKLES and not _is_safe_load(call):
            return ".".join(name)
    if any(word.arg == "shell" and getattr(word.value, "value", None) is True for word in call.keywords):
        return "shell=True"
    return None


def test_no_file_of_a_stranger_is_run() -> None:
    errors = {}
    for package in PACKAGES:
        for path in package.rglob("*.py"):
            name = path.relative_to(ROOT).as_posix()
            bad = [error for call in _calls(path) if (error := _errors(call))]
            if bad and name not in MAY_UNPICKLE:
                errors[name] = bad
    assert errors == {}


def test_the_check_sees_what_it_forbids() -> None:
    def error(code: str) -> str | None:
        node = ast.parse(code, mode="eval").body
        assert isinstance(node, ast.Call)
        return _errors(node)

    assert error("eval(x)") == "eval"
    assert error("np.load(x)") == "np.load"
    assert error("np.load(x, allow_pickle=False)") is None
    assert error("run(x, shell=True)") == "shell=True"
