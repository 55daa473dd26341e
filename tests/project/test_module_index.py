"""The index in the `__init__.py` of a package has its modules and limits, and names only tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.module_index import ROOT, TITLE, indexes

INDEXES = indexes()


def entries(index: str) -> dict[str, tuple[list[str], list[str]]]:
    """Limits and tests by module."""
    text = re.sub(r"\n#   ", " ", index)
    return {
        module: (re.findall(r"\b[A-Z][A-Z0-9_]+\b", limits), re.findall(r"[\w./]*test_\w+\.py", tests))
        for module, limits, tests in re.findall(
            r"^# - (\w+): .*?(?: Limits: ([^.]*)\.)?(?: Tests: (.*)\.)?$", text, re.M
        )
    }


@pytest.mark.parametrize("file", INDEXES, ids=lambda file: str(file.parent.relative_to(ROOT)))
def test_the_index_of_a_package_is_that_of_its_modules(file: Path) -> None:
    """Otherwise: `python docs/module_index.py` writes it again."""
    _, title, index = file.read_text(encoding="utf-8").partition(TITLE)
    assert title, "python docs/module_index.py writes the index"
    folder = ROOT / index.partition("`")[2].partition("`")[0]
    written, expected = entries(index), entries(INDEXES[file])
    limits = {module: row[0] for module, row in written.items()}
    assert limits == {module: row[0] for module, row in expected.items()}, "python docs/module_index.py"
    assert all((folder / test).is_file() for _, tests in written.values() for test in tests)


def test_an_entry_has_limits_and_tests() -> None:
    found = entries(INDEXES[ROOT / "estimator" / "association" / "__init__.py"])
    assert "MIN_JOIN_AFFINITY" in found["tracks"][0]
    assert "test_tracks.py" in found["tracks"][1]
