"""Folders of WordNet, and the message without it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from taxonomy import wordnet as module
from taxonomy.wordnet import ENVIRONMENT_VARIABLE, NoWordNet, UnknownSynset, WordNet
from tests.synthetic.miniwordnet import write_wordnet


def test_senses_come_in_wordnets_order(mini_wordnet: WordNet) -> None:
    assert mini_wordnet.senses("mouse") == ("mouse.n.01", "mouse.n.02")
    assert mini_wordnet.senses("TV") == ("television.n.01", "television_receiver.n.01")
    assert mini_wordnet.senses("swivel chair") == ("swivel_chair.n.01",)
    assert mini_wordnet.senses("office chair") == ()


def test_hypernyms_are_nearest_first(mini_wordnet: WordNet) -> None:
    above = mini_wordnet.hypernyms("swivel_chair.n.01")
    assert above[:3] == ("chair.n.01", "seat.n.01", "furniture.n.01")
    assert above[-1] == "entity.n.01"


def test_what_a_synset_says(mini_wordnet: WordNet) -> None:
    assert mini_wordnet.lemmas("mouse.n.02") == ("mouse", "computer mouse")
    assert mini_wordnet.synset("stool.n.01").definition() == "a simple seat without a back or arms"
    assert mini_wordnet.irregular_plurals["mice"] == ("mouse",)
    assert "chest of drawers" in mini_wordnet.nouns


def test_a_synset_by_its_offset(mini_wordnet: WordNet) -> None:
    assert mini_wordnet.synset_at(f"n{mini_wordnet.synset('stool.n.01').offset():08d}") == "stool.n.01"


@pytest.mark.parametrize("offset", ["n00000001", "02119789", "nabc", "", "n"])
def test_an_offset_that_is_none_is_named(mini_wordnet: WordNet, offset: str) -> None:
    with pytest.raises(UnknownSynset, match="offset: expected n and the eight digits"):
        mini_wordnet.synset_at(offset)


@pytest.mark.parametrize("name", ["chair", "chair.n.99", "chair.n.xx", "chair.v.01", "nothing.n.01", ""])
def test_a_name_that_is_no_synset_is_named(mini_wordnet: WordNet, name: str) -> None:
    assert not mini_wordnet.knows(name)
    with pytest.raises(UnknownSynset, match=r"^synset: expected .* found"):
        mini_wordnet.parents(name)


def test_a_folder_without_wordnet_says_how_to_get_it(tmp_path: Path) -> None:
    with pytest.raises(NoWordNet, match=r"apt-get install wordnet-base.*nltk\.downloader wordnet"):
        WordNet(tmp_path)


def test_another_release_is_refused(tmp_path: Path) -> None:
    folder = write_wordnet(tmp_path / "wn", licence="  1 In the form of WordNet 3.1 Copyright 2011\n")
    with pytest.raises(NoWordNet, match=r"expected WordNet 3\.0.*found 3\.1"):
        WordNet(folder)


def test_the_environment_names_a_folder(written_wordnet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, str(written_wordnet))
    assert WordNet().senses("vase") == ("vase.n.01",)


def test_nltks_folder_is_found(written_wordnet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import nltk.data

    (tmp_path / "corpora").mkdir()
    written_wordnet.rename(tmp_path / "corpora" / "wordnet")
    monkeypatch.delenv(ENVIRONMENT_VARIABLE, raising=False)
    monkeypatch.setattr(module, "_DEBIAN", tmp_path / "nowhere")
    monkeypatch.setattr(nltk.data, "path", [str(tmp_path)])
    assert WordNet().senses("vase") == ("vase.n.01",)
    monkeypatch.setattr(nltk.data, "path", [])
    with pytest.raises(NoWordNet, match=r"neither in .*nowhere nor among nltk's data"):
        WordNet()


def test_debians_wordnet_reads_as_it_should(wordnet: WordNet) -> None:
    assert wordnet.synset_at("n02119789") == "kit_fox.n.01"
    assert wordnet.senses("tv")[0] == "television.n.01"
    assert len(wordnet.nouns) > 100_000
    assert [lemma.count() for lemma in wordnet.synset("chair.n.01").lemmas()] == [35]


@pytest.mark.slow
@pytest.mark.parametrize("seed", ["1", "2"])  # a set of the two is in the one order, and in the other
def test_parents_come_in_wordnets_order_in_every_run(wordnet: WordNet, seed: str) -> None:
    """The library keeps them in a set, so that their order changed from run to run, and with it a tie of two kinds."""
    script = "from taxonomy.wordnet import WordNet; print(*WordNet().parents('beverage.n.01'))"
    environment = os.environ | {"PYTHONHASHSEED": seed}
    run = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True, timeout=300
    )
    assert run.stdout.split() == ["food.n.01", "liquid.n.01"] == list(wordnet.parents("beverage.n.01"))


def test_importing_the_module_loads_no_nltk() -> None:
    code = "import sys, taxonomy.wordnet, taxonomy.matching.matcher; print('nltk' in sys.modules)"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300).stdout
        == "False\n"
    )


def test_a_folder_outranks_the_environment(
    written_wordnet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, str(tmp_path / "nowhere"))
    assert WordNet(written_wordnet).senses("vase") == ("vase.n.01",)
    with pytest.raises(NoWordNet, match="nowhere: expected"):
        WordNet()
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, "")  # as if it were not set
    monkeypatch.setattr(module, "_DEBIAN", written_wordnet)
    assert WordNet().senses("vase") == ("vase.n.01",)
