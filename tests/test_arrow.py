"""Data flows one way: a package imports only what lies upstream, and light commands stay light."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from tests.made import minitree

ROOT = Path(__file__).resolve().parents[1]
FLOW = ["metric_base", "crawler", "taxonomy", "metric_tree", "estimator"]
#: Commands may import any package, lazily (contracts.md, "Command lines").
COMMANDS = {"metric_tree/commands", "estimator/command.py"}
#: What a query never loads.
HEAVY = ["sklearn", "open3d", "nltk", "scrapy", "pandas", "scipy", "matplotlib", "cv2", "pycolmap", "rembg", "dask"]


def _imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: expected absolute imports"
            found.add(node.module or "")
    return found


def _backward(package: str, imported: set[str]) -> set[str]:
    downstream = FLOW[FLOW.index(package) + 1 :]
    return {name for name in imported if name.split(".")[0] in downstream}


@pytest.mark.parametrize("package", FLOW)
def test_no_import_runs_back(package: str) -> None:
    back = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if not any(name.startswith(command) for command in COMMANDS) and (found := _backward(package, _imports(path))):
            back[name] = sorted(found)
    assert back == {}


def test_an_arrow_that_runs_back_is_seen() -> None:
    assert _backward("crawler", {"metric_tree.tree", "json"}) == {"metric_tree.tree"}
    assert _backward("estimator", {"crawler.items", "metric_tree"}) == set()


def test_a_query_loads_nothing_heavy(tmp_path: Path) -> None:
    directory = minitree.release(tmp_path / "mini").directory
    code = (
        f"import sys; import metric_tree; tree = metric_tree.open({str(directory)!r});"
        "tree.find('swivel chair').prior().interval(0.9);"
        f"print(sorted(set({HEAVY!r}) & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
