"""Nouns of WordNet 3.0, from the files of Debian or nltk; only this module uses the reader of nltk."""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from metric_base.errors import InputError, UnknownKey

#: Environment variable with a folder of the files of WordNet (`data.noun`, `index.noun`, ...), used before all others.
ENVIRONMENT_VARIABLE = "METRIC_TREE_WORDNET"

#: Version of WordNet, on which the names of the synsets in the tree depend.
VERSION = "3.0"

_DEBIAN = Path("/usr/share/wordnet")
_HOW_TO_GET_IT = "apt-get install wordnet-base, or python -m nltk.downloader wordnet"

#: Number of lexicographer files, whose names nltk reads from a file that the package of Debian lacks (lexnames(5WN)).
_N_LEXNAMES = 45


class NoWordNet(InputError):
    """WordNet is not installed; the message explains how to install it."""


class UnknownSynset(UnknownKey):
    """A name is not a noun synset of WordNet 3.0."""


class WordNet:
    """Noun synsets by name (`chair.n.01`).

    Parameters
    ----------
    path : Path, optional
        Folder of the files of WordNet. By default that of `METRIC_TREE_WORDNET`, else of Debian, else of nltk.

    Raises
    ------
    NoWordNet
        There is no WordNet, or another version.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._reader = _reader(path)
        self._memory: dict[str, Any] = {}

    def senses(self, noun: str) -> tuple[str, ...]:
        """Return the synsets of a noun, written with spaces or underscores, the most frequent first."""
        return tuple(map(self.at, self.offsets(noun)))

    def offsets(self, noun: str) -> tuple[int, ...]:
        """Return the offsets of the synsets of a noun (`senses`), without reading the synsets."""
        return tuple(self._reader._lemma_pos_offset_map.get(noun.lower().replace(" ", "_"), {}).get("n", ()))

    def at(self, offset: int) -> str:
        """Return the noun synset at an offset of `offsets`."""
        return str(self._reader.synset_from_pos_and_offset("n", offset).name())

    def synset(self, name: str) -> Any:
        """Return the record of nltk of a noun synset. Raises UnknownSynset if there is none."""
        if name not in self._memory:
            from nltk.corpus.reader.wordnet import WordNetError

            if name.count(".n.") != 1:
                raise UnknownSynset(f"synset: expected a name such as chair.n.01; found {name!r}")
            try:
                self._memory[name] = self._reader.synset(name)
            except (WordNetError, ValueError):
                raise UnknownSynset(f"synset: expected a noun synset of WordNet {VERSION}; found {name!r}") from None
        return self._memory[name]

    def knows(self, synset: str) -> bool:
        """Return True if a name is a noun synset."""
        try:
            self.synset(synset)
        except UnknownSynset:
            return False
        return True

    def parents(self, synset: str) -> tuple[str, ...]:
        """Return the synsets one step above: hypernyms, then the classes of an instance."""
        record = self.synset(synset)
        return tuple(above.name() for above in (*record.hypernyms(), *record.instance_hypernyms()))

    def canonical(self, synset: str) -> str:
        """Return the name of a synset by its first word: `sofa.n.01` for `couch.n.01`."""
        return str(self.synset(synset).name())

    @cache  # noqa: B019 - one WordNet lives as long as the process
    def hypernyms(self, synset: str) -> tuple[str, ...]:
        """Return all synsets above a synset over all paths, nearest first."""
        return nearest_first(synset, self.parents)

    def lemmas(self, synset: str) -> tuple[str, ...]:
        """Return the words of a synset with spaces, in the order of WordNet."""
        return tuple(name.replace("_", " ") for name in self.synset(synset).lemma_names())

    def synset_at(self, offset: str) -> str:
        """Return the synset of an offset such as `n02119789`.

        Raises
        ------
        UnknownSynset
            No noun synset has this offset.
        """
        digits = offset[1:]
        if not (offset[:1] == "n" and digits.isdigit() and int(digits) in self._offsets):
            raise UnknownSynset(f"offset: expected n and the eight digits of a WordNet 3.0 noun; found {offset!r}")
        return self.at(int(digits))

    @cached_property
    def nouns(self) -> frozenset[str]:
        """All nouns in lower case with spaces."""
        entries = self._reader._lemma_pos_offset_map.items()
        return frozenset(word.replace("_", " ") for word, by_pos in entries if "n" in by_pos)

    @cached_property
    def words(self) -> frozenset[str]:
        """All single words of any part of speech, in lower case."""
        return frozenset(word for word in self._reader._lemma_pos_offset_map if word.isalpha())

    @cached_property
    def irregular_plurals(self) -> dict[str, tuple[str, ...]]:
        """Singulars by irregular plural (`noun.exc`), with spaces."""
        exceptions: dict[str, list[str]] = self._reader._exception_map["n"]
        return {
            plural.replace("_", " "): tuple(single.replace("_", " ") for single in singles)
            for plural, singles in exceptions.items()
        }

    @cached_property
    def _offsets(self) -> frozenset[int]:
        return frozenset(
            offset for by_pos in self._reader._lemma_pos_offset_map.values() for offset in by_pos.get("n", ())
        )


def nearest_first(synset: str, parents: Callable[[str], tuple[str, ...]]) -> tuple[str, ...]:
    """Return all synsets above a synset over all paths, nearest first; `parents` returns those one step above."""
    seen: dict[str, None] = {}
    level = parents(synset)
    while level:
        fresh = [name for name in dict.fromkeys(level) if name not in seen]
        seen.update(dict.fromkeys(fresh))
        level = tuple(above for name in fresh for above in parents(name))
    return tuple(seen)


@cache
def default_wordnet() -> WordNet:
    """Return the WordNet of this machine, which is loaded once (0.9 s)."""
    return WordNet()


def _reader(path: Path | None) -> Any:
    """Return a reader of nltk for the first WordNet that is found."""
    root = _root(path)
    reader = _reader_class()(root, None)
    if reader.get_version() != VERSION:
        actual = reader.get_version()
        raise NoWordNet(f"{root}: expected WordNet {VERSION}, whose synset names the tree uses; found {actual}")
    return reader


def _root(path: Path | None) -> Any:
    """Return the location of WordNet in the terms of nltk: a folder, or a path in a zip file."""
    import nltk.data

    named = path or (Path(os.environ[ENVIRONMENT_VARIABLE]) if os.environ.get(ENVIRONMENT_VARIABLE) else None)
    for folder in (named,) if named else (_DEBIAN,):
        if (folder / "data.noun").is_file() and (folder / "index.noun").is_file():
            # nltk opens only files on its search path
            nltk.data.path.append(str(folder.resolve()))
            return nltk.data.FileSystemPathPointer(str(folder.resolve()))
    if named:
        raise NoWordNet(f"{named}: expected WordNet's files (data.noun, index.noun); get them by {_HOW_TO_GET_IT}")
    for entry in ("corpora/wordnet", "corpora/wordnet.zip/wordnet/"):
        with suppress(LookupError):
            return nltk.data.find(entry)
    raise NoWordNet(f"WordNet is neither in {_DEBIAN} nor among nltk's data: {_HOW_TO_GET_IT}")


@cache
def _reader_class() -> Any:
    from nltk.corpus.reader.wordnet import WordNetCorpusReader

    class _Reader(WordNetCorpusReader):  # type: ignore[misc]
        """Reader of nltk without the names of lexicographer files and without the maps of other languages."""

        def __init__(self, root: Any, omw_reader: None) -> None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # it warns that other languages are missing
                super().__init__(root, omw_reader)

        def open(self, file: str) -> Any:
            if file == "lexnames":
                return io.StringIO("".join(f"{i:02d}\tunused\t0\n" for i in range(_N_LEXNAMES)))
            return super().open(file)

        def _synset_from_pos_and_line(self, pos: str, line: str) -> Any:
            """Read a synset with its relations in the order of WordNet; nltk stores them in an unordered set."""
            synset = super()._synset_from_pos_and_line(pos, line)
            fields = line.split()
            first = 5 + 2 * int(fields[3], 16)  # after the words, each with a number, and the count of pointers
            ordered: dict[str, dict[tuple[str, int], None]] = {}
            for at in range(first, first + 4 * int(fields[first - 1]), 4):
                symbol, offset, part_of_speech, lemmas = fields[at : at + 4]
                if lemmas == "0000":  # between synsets, not between their words
                    ordered.setdefault(symbol, {})[part_of_speech, int(offset)] = None
            synset._pointers = ordered
            return synset

        def map_wn(self, version: str = "wordnet") -> None:  # noqa: ARG002 - nltk's signature
            return None

    return _Reader
