from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from crawler.items import RawItem
from metric_cli.subcommands import main
from metric_tree.tree import Tree
from taxonomy.wordnet import NoWordNet, default_wordnet
from tests.support.skips import skip_without


def test_an_item_is_explained_from_its_words_to_its_node(mini: Tree, shown: Any, tmp_path: Path) -> None:
    item = mini.find("swivel chair").items().to_pylist()[0]
    raw = RawItem(
        source=item["source"],
        source_id=item["source_id"],
        title="A fine one",
        category_path=("Office", "Swivel chairs"),
        dimensions_mm={"height": 1000.0},
        kind="product",
    )
    file = tmp_path / "raw.jsonl"
    file.write_text(raw.line() + "\n", encoding="utf-8")
    with skip_without(NoWordNet):
        default_wordnet()
    status, found = shown("explain", item["item_id"], str(file), "--tree", str(mini.release.directory))
    assert status == 0
    assert found["words"]["category_path"] == "Office > Swivel chairs"
    assert found["match"]["concept"] == "swivel_chair.n.01"
    assert found["release"]["node"] == "swivel_chair.n.01"
    assert found["release"]["path"][-1] == "swivel chair"
    assert found["release"]["height_mm"] == item["height_mm"]


def test_an_item_that_is_nowhere_is_one_line(mini: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "shop:none", "--tree", str(mini.release.directory)]) == 2
    error = capsys.readouterr().err
    assert "'shop:none'" in error
    assert error.count("\n") == 1


def test_an_item_that_is_not_shown_says_why(mini: Tree, shown: Any, tmp_path: Path) -> None:
    """Refused by the build according to its log, or unknown."""
    raw = RawItem(source="shop", source_id="x", title="A fine one", category_path=("chair",), kind="product")
    file = tmp_path / "raw.jsonl"
    file.write_text(raw.line() + "\n", encoding="utf-8")
    (tmp_path / "quarantine.jsonl").write_text('{"reason": "no_category", "source": "shop", "source_id": "x"}\n')
    words = ("explain", "shop:x", str(file), "--tree", str(mini.release.directory))
    assert shown(*words, "--log", str(tmp_path))[1]["release"]["why"] == "refused: no_category"
    assert "--log" in shown(*words)[1]["release"]["why"]
    assert shown(*words)[1]["release"]["shipped"] is False
    assert main([*words, "--log", str(tmp_path / "none")]) == 2
    (tmp_path / "quarantine.jsonl").write_text('{"reason": "no_category"')
    assert main([*words, "--log", str(tmp_path)]) == 2
