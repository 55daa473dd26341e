"""The tables that say what a word means: senses of WordNet, trust in head nouns, codes of label lists, reviewed order.

`python -m benchmarks.taxonomy.word_tables` writes all but `meanings.csv`, which a reviewer (a program: a language
model) writes: the words that several nodes share, with the nodes in the order in which people mean them. The tables
are read on demand, each once, as text that is searched: a first answer must not wait for fifty thousand lines to be
parsed.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from metric_base.folders import taxonomy_directory

__all__ = ["Meanings", "Sense", "coded_node", "head_trust", "reviewed_meanings", "senses"]

# A scan of the longest table takes a millisecond, its index 40: it is made for those who ask often.
SCANS = 50
_ASKED: Counter[str] = Counter()


@dataclass(frozen=True, slots=True)
class Sense:
    """One sense of a word: how often it is meant in WordNet's texts, and its node and those above, nearest first."""

    count: int
    nodes: tuple[str, ...]


def senses(word: str) -> tuple[Sense, ...]:
    """The senses of a folded word in WordNet's order, those that are no things without nodes; empty if unknown."""
    line = _value("senses.tsv", word)
    return tuple(_sense(part) for part in line.split(";")) if line else ()


@dataclass(frozen=True, slots=True)
class Meanings:
    """The nodes that share a word, in a reviewer's order; `clear` if the first is meant nearly always."""

    nodes: tuple[str, ...]
    clear: bool


def reviewed_meanings(word: str) -> Meanings | None:
    """The reviewed order of what a folded word means; None for a word that no reviewer has ordered."""
    row = _value("meanings.csv", word, ",")
    if not row:
        return None
    nodes, clear, *_ = row.split(",")
    return Meanings(tuple(nodes.split()), clear == "yes")


def head_trust(head: str) -> dict[str, tuple[int, int]]:
    """By node: how many of the known compounds that end in a word are such things, and how many there are."""
    lines = _text("heads.tsv")
    trust = {}
    at = lines.find(f"\n{head}\t")
    while at >= 0:
        end = lines.find("\n", at + 1)
        _, node, kinds, compounds = lines[at + 1 : end].split("\t")
        trust[node] = (int(kinds), int(compounds))
        at = end if lines.startswith(f"\n{head}\t", end) else -1
    return trust


def coded_node(code: str) -> str | None:
    """The node of ImageNet's `n02119789` or Open Images' `/m/01mzpv`; None if the code is unknown."""
    return _value("codes.tsv", code) or None


def _sense(part: str) -> Sense:
    count, _, nodes = part.partition(":")
    return Sense(int(count), tuple(nodes.split(">")) if nodes else ())


def _value(table: str, key: str, separator: str = "\t") -> str:
    text = _text(table)
    _ASKED[table] += 1
    indexed = _ASKED[table] > SCANS
    at = _places(table, separator).get(key, -1) if indexed else text.find(f"\n{key}{separator}")
    return text[at + len(key) + 2 : text.find("\n", at + 1)] if at >= 0 else ""


@cache
def _places(table: str, separator: str) -> dict[str, int]:
    """Where the first line of each key begins in the text of a table."""
    places: dict[str, int] = {}
    for line in re.finditer(rf"\n([^\n{separator}]*){separator}", _text(table)):
        places.setdefault(line[1], line.start())
    return places


@cache
def _text(table: str) -> str:
    file: Path = taxonomy_directory() / table
    return "\n" + file.read_text(encoding="utf-8") if file.is_file() else "\n"
