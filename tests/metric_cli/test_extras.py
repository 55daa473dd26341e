"""Optional dependencies: declared where they are used, and named where they are missing."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from metric_cli.errors import MODULES_BY_EXTRA, exit_status, missing_extra

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = [path.parent.name for path in sorted(ROOT.glob("*/py.typed"))]
#: `mpl_toolkits` is part of matplotlib; Blender brings its own Python with the next two; `omni` is the validator that
#: requests our rule; `script` is next to `layer_script` in the folder of layers that Blender opens.
FROM_ELSEWHERE = {"mpl_toolkits", "bpy", "mathutils", "omni", "script"}
DECLARED = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def _names(requirements: list[str]) -> set[str]:
    return {re.split(r"[\[<>=!~; ]", line)[0].lower().replace("_", "-") for line in requirements}


def _used_modules() -> set[str]:
    modules = set()
    for package in (*PACKAGES, "integrations/train_detector"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import):
                    modules |= {alias.name.partition(".")[0] for alias in node.names}
                elif isinstance(node, ast.ImportFrom):
                    modules.add((node.module or "").partition(".")[0])
    return modules - set(PACKAGES) - set(sys.stdlib_module_names) - FROM_ELSEWHERE


def _distributions() -> dict[str, set[str]]:
    return {
        module: {name.lower().replace("_", "-") for name in names}
        for module, names in metadata.packages_distributions().items()
    }


def test_what_is_used_is_declared_and_what_is_declared_is_used() -> None:
    declared = _names(DECLARED["dependencies"]).union(*map(_names, DECLARED["optional-dependencies"].values()))
    declared.discard("metric-tree")
    providers = _distributions()
    used = set()
    undeclared = []
    for module in sorted(_used_modules()):
        by = providers.get(module, {module}) & declared
        used |= by
        if not by:
            undeclared.append(module)
    assert undeclared == []
    # imported by pyarrow for `Tree.to_pandas`, by torch for the export, and by fsspec for URLs
    assert declared - used == {"pandas", "onnx", "s3fs", "gcsfs", "adlfs"}


@pytest.mark.parametrize("extra", MODULES_BY_EXTRA)
def test_an_extra_brings_the_modules_that_it_is_named_for(extra: str) -> None:
    names = _names(DECLARED["optional-dependencies"][extra])
    providers = _distributions()
    assert [module for module in MODULES_BY_EXTRA[extra] if not providers.get(module, {module}) & names] == []


def test_a_module_that_no_extra_brings() -> None:
    assert missing_extra("nowhere") is None
    assert missing_extra(None) is None


def test_a_missing_extra_is_one_line_and_2(capsys: pytest.CaptureFixture[str]) -> None:
    def run() -> int:
        raise ModuleNotFoundError("No module named 'scrapy'", name="scrapy")

    assert exit_status("metric-tree crawl", run) == 2
    assert capsys.readouterr().err == "metric-tree crawl: needs metric-tree[crawl]: pip install 'metric-tree[crawl]'\n"


def test_a_module_of_our_own_that_is_missing_is_an_error_of_the_program(capsys: pytest.CaptureFixture[str]) -> None:
    def run() -> int:
        raise ModuleNotFoundError("No module named 'crawler.nowhere'", name="crawler.nowhere")

    assert exit_status("x", run) == 1
    assert "internal error" in capsys.readouterr().err


def test_a_query_without_any_extra(tmp_path: Path) -> None:
    """All modules of all extras are hidden: a query and `--objects` work, a scene names the extra."""
    # pyarrow requests the version of a pandas that is in `sys.modules`, be it None
    hidden = sorted({module for modules in MODULES_BY_EXTRA.values() for module in modules} - {"pandas"})
    (tmp_path / "objects.json").write_text(
        '{"schema": "metric-tree/objects/1", "objects": ['
        '{"category": "chair", "dimensions": {"length": 0.3, "width": 0.28, "height": 0.45}},'
        '{"category": "car", "dimensions": {"length": 2.2, "width": 0.9, "height": 0.75}}]}',
        encoding="utf-8",
    )
    code = f"""
import sys
for name in {hidden!r}:
    sys.modules[name] = None
from metric_cli.subcommands import main
from metric_cli.estimate_scale.estimate import main as estimate
assert main(["query", "chair", "--images", "2"]) == 0
assert estimate(["--objects", {str(tmp_path / "objects.json")!r}]) == 0
raise SystemExit(estimate([{str(ROOT / "data/scenes/demo_room")!r}]))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False, timeout=300
    )
    assert done.returncode == 2, done.stderr
    assert "needs metric-tree[scene]: pip install" in done.stderr
