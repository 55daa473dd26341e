"""`--version` states the versions of the program and of the data; files of a release state the same version."""

from __future__ import annotations

import re
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

import metric_tree

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("program", ["metric-tree", "estimate-scale", "insert-object"])
def test_version_states_program_and_data(program: str, capsys: pytest.CaptureFixture[str]) -> None:
    module = {
        "metric-tree": "metric_cli.subcommands",
        "estimate-scale": "metric_cli.estimate_scale.estimate",
        "insert-object": "metric_cli.insert_object.insert",
    }[program]
    with pytest.raises(SystemExit) as ended:
        import_module(module).main(["--version"])
    assert ended.value.code == 0
    data = re.escape(metric_tree.open().version)
    assert re.fullmatch(rf"{program} \S+ \(object sizes: release {data}\)\n", capsys.readouterr().out)


def test_version_is_the_same_in_all_files_of_the_project() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(rf"^## {re.escape(version)}( |$)", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"Version {version} contains release {metric_tree.open().version} of the sizes" in readme
