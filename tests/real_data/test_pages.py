"""The sizes read from saved real pages equal the sizes that a person read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from crawler.page.page import saved_page
from crawler.sites.registry import item_of

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / "pages"
PAGES = json.loads((FOLDER / "truth.json").read_text())["pages"] if FOLDER.is_dir() else [None]

#: Relative tolerance: pages round to 0.5 mm, 0.5 cm or 0.1 inch.
TOLERANCE = 0.02


def _extents(expect: dict[str, Any]) -> list[float]:
    labels = [str(label).lower() for label in expect["labels"] or []]
    twice = [mm for label, mm in zip(labels, expect["mm"], strict=False) if label == "diameter"]
    return sorted([*expect["mm"], *twice][:3], reverse=True)


@pytest.mark.real_data
@pytest.mark.parametrize("truth", PAGES, ids=[page["file"] if page else "absent" for page in PAGES])
def test_size_of_a_real_page_equals_its_truth_or_is_marked(truth: dict[str, Any] | None) -> None:
    if truth is None:
        pytest.skip(f"{FOLDER} does not exist: the saved real pages are not part of the repository")
    item = item_of(saved_page(FOLDER / truth["file"], truth["url"]))
    if truth["expect"] is None:
        assert item.extents_mm is None or "low_trust" in item.flags
    else:
        assert item.extents_mm == pytest.approx(_extents(truth["expect"]), rel=TOLERANCE)
        assert "low_trust" not in item.flags
    assert item.title
