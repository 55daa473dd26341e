"""The hooks of the documentation site convert notebooks, links to the repository and formulas."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("site_hooks", ROOT / "docs" / "site_hooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_tutorial_runs_as_a_notebook(hooks: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    record = hooks.notebook((ROOT / "docs" / "tutorial" / "first-tree.md").read_text(encoding="utf-8"))
    assert record["nbformat"] == 4
    codes = [cell["source"] for cell in record["cells"] if cell["cell_type"] == "code"]
    assert codes[0].startswith("!metric-tree query")
    names: dict[str, object] = {}
    for code in codes[1:]:
        exec(compile(code, "cell", "exec"), names)
    assert "swivel chair" in capsys.readouterr().out
    assert any("```sh" in cell["source"] for cell in record["cells"])  # shell blocks that are not run remain text


def test_links_outside_the_pages_point_to_the_repository(hooks: ModuleType) -> None:
    folder = ROOT / "docs" / "how-to"
    text = hooks.repository_links("[a](../../README.md#x) [b](evidence.md) [c](https://example.org)", folder)
    assert text == f"[a]({hooks.REPOSITORY}README.md#x) [b](evidence.md) [c](https://example.org)"
    assert hooks.repository_links("[a](docs/how-to/evidence.md)", ROOT) == "[a](how-to/evidence.md)"
    with pytest.raises(FileNotFoundError, match=r"nowhere\.md"):
        hooks.repository_links("[a](nowhere.md)", folder)


@pytest.mark.skipif(
    importlib.util.find_spec("latex2mathml") is None,
    reason="latex2mathml is not installed; it is in the dependency group `docs` (`make docs`)",
)
def test_formulas_are_converted_to_mathml(hooks: ModuleType) -> None:
    page = hooks.on_page_content('<span class="arithmatex">\\(a &lt; b_1\\)</span>')
    assert page.startswith("<math")
    assert "msub" in page


def test_formulas_of_a_line_of_their_own_have_dollar_signs() -> None:
    """The site shows a block `math` as code; on a code host both forms are formulas."""
    assert [page.name for page in (ROOT / "docs").rglob("*.md") if "```math" in page.read_text(encoding="utf-8")] == []
