"""A small WordNet, and Debian's where it is installed."""

from __future__ import annotations

from pathlib import Path

import pytest

from taxonomy.wordnet import NoWordNet, WordNet, default_wordnet
from tests.support.skips import skip_without
from tests.synthetic.miniwordnet import write_wordnet


@pytest.fixture(scope="session")
def mini_wordnet(tmp_path_factory: pytest.TempPathFactory) -> WordNet:
    """Two dozen nouns."""
    return WordNet(write_wordnet(tmp_path_factory.mktemp("wordnet")))


@pytest.fixture(scope="module")
def wordnet() -> WordNet:
    """The whole of WordNet 3.0, or a skip that states how to get it."""
    with skip_without(NoWordNet):
        return default_wordnet()


@pytest.fixture
def written_wordnet(tmp_path: Path) -> Path:
    """A folder with WordNet's files."""
    return write_wordnet(tmp_path / "wn")
