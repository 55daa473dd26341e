"""Meanings of words: senses in WordNet, their reviewed order, evidence for head nouns, codes and labels of detectors.

`python -m data.generate words` writes all tables except two that a reviewer (a language model) writes: `meanings.csv`,
words that several nodes share with the nodes in the order of use, and `other_names.csv`, names in other languages and
names of standards. The tables are searched as text and loaded when needed, because parsing fifty thousand lines would
delay the first query.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

from metric_base.folders import taxonomy_directory
from taxonomy.words.spelling import SPELLINGS, plain_fold, without_accents

#: Number of searches of a table before it is indexed: a search takes 1 ms, an index of the longest table 40 ms.
MAX_SCANS = 50
_SEARCHES: Counter[str] = Counter()

#: Label lists in the order of search: the most used detectors first.
DETECTOR_LISTS = (
    "coco_80", "lvis_v1", "openimages_601", "objects365_v2", "ade20k_150", "scannet200", "omni3d_50", "sunrgbd_10",
    "nuscenes_32", "kitti_8", "cityscapes_35", "waymo_4", "argoverse2_30", "mapillary_vistas_66", "things_1854",
    "matterport_1659", "imagenet_1k",
)  # fmt: skip

#: Weight of a label by list: the four lists on which most detectors are trained.
LABEL_WEIGHT = {"coco_80": 3.0, "lvis_v1": 2.0, "openimages_601": 2.0, "objects365_v2": 2.0}
#: Weight of a label of another list.
LABEL_WEIGHT_ELSEWHERE = 0.7
#: Spelling without umlauts: `Kuehlschrank`.
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue"})


@dataclass(frozen=True, slots=True)
class Sense:
    """A sense of a word."""

    chain: tuple[str, ...]  #: Its concept and those above it, nearest first; empty if it is not an object.
    count: int = 0  #: Number of occurrences in the tagged texts of WordNet.

    @property
    def concept(self) -> str:
        """The concept of the sense."""
        return self.chain[0]

    def is_a(self, kinds: Iterable[str]) -> bool:
        """Return True if the concept is one of `kinds` or below one."""
        return any(kind in self.chain for kind in kinds)


class Meanings(NamedTuple):
    """Nodes that share a word, in a reviewed order; `clear` if the word nearly always means the first."""

    nodes: tuple[str, ...]
    clear: bool


def senses(word: str) -> tuple[Sense, ...]:
    """Return the senses of a folded word as nodes of the tree, in the order of WordNet; empty if unknown."""
    line = _value("generated/senses.tsv", word)
    parts = (part.partition(":") for part in line.split(";")) if line else ()
    return tuple(Sense(tuple(nodes.split(">")) if nodes else (), int(count)) for count, _, nodes in parts)


def reviewed_meanings(word: str) -> Meanings | None:
    """Return the nodes of a folded word in their reviewed order; None if they were not reviewed."""
    row = _value("meanings.csv", word, ",")
    if not row:
        return None
    nodes, clear, *_ = row.split(",")
    return Meanings(tuple(nodes.split()), clear == "yes")


def head_trust(head: str) -> dict[str, tuple[int, int]]:
    """Return, by node, the number of known compounds that end in a word and are such items, and their total number."""
    lines = _text("generated/heads.tsv")
    trust = {}
    at = lines.find(f"\n{head}\t")
    while at >= 0:
        end = lines.find("\n", at + 1)
        _, node, kinds, compounds = lines[at + 1 : end].split("\t")
        trust[node] = (int(kinds), int(compounds))
        at = end if lines.startswith(f"\n{head}\t", end) else -1
    return trust


def coded_node(code: str) -> str | None:
    """Return the node of a code of ImageNet (`n02119789`) or Open Images (`/m/01mzpv`); None if it is unknown."""
    return _value("generated/codes.tsv", code) or None


def is_english(word: str) -> bool:
    """Return True if a folded word is English, even if it is not a name: `tunnel` is not a misspelt `funnel`."""
    return bool(senses(word)) or f"\n{word}\n" in _text("generated/near_words.txt")


def other_names(form: str) -> Mapping[str, str]:
    """Return, by node, the language of a folded word that names it, or `norm` for standards."""
    # a search for the longest word comes first, because folding the table takes as long as the rest of a query
    word = max(form.split(), key=len, default="")
    if _without_umlauts(word) not in _other_letters() and word not in SPELLINGS.values():
        return {}
    return names_in_languages().get(form, {})


@cache
def _other_letters() -> str:
    cells = "\n".join(line.partition(",")[2] for line in _text("other_names.csv").split("\n"))
    plain = without_accents(cells).encode("ascii", "ignore").decode()
    return _without_umlauts(plain.replace("'", "").replace("`", ""))


def _without_umlauts(text: str) -> str:
    """Return a text with the same spelling for both ways to write an umlaut."""
    return text.replace("ae", "a").replace("oe", "o").replace("ue", "u")


@cache
def names_in_languages() -> Mapping[str, Mapping[str, str]]:
    """Return the table of `other_names`: languages by node, by folded word."""
    named: defaultdict[str, dict[str, str]] = defaultdict(dict)
    lines = _text("other_names.csv").split("\n")[1:-1] or ["node_id"]
    _, *languages = lines[0].split(",")
    for line in lines[1:]:
        node_id, *cells = line.split(",")
        for language, words in zip(languages, cells, strict=True):
            for word in filter(None, words.split("; ")):
                for spelling in (word,) if word.isascii() else (word, word.translate(_UMLAUTS)):
                    named[plain_fold(spelling)].setdefault(node_id, language)
    return named


def label_votes(form: str) -> Mapping[str, float]:
    """Return the weights by node of a folded word in the reviewed label lists, the most used list first."""
    return _votes().get(form, {})


def node_uses() -> dict[str, float]:
    """Return the largest weight of each node over the label lists."""
    uses: dict[str, float] = {}
    for meant in _votes().values():
        for node_id, weight in meant.items():
            uses[node_id] = max(uses.get(node_id, 0.0), weight)
    return uses


@cache
def _votes() -> Mapping[str, dict[str, float]]:
    from taxonomy.label_lists import vocabulary  # most names need no list

    # a list may have a word twice, for two nodes (crane in ImageNet)
    by_list: dict[str, dict[str, set[str]]] = {name: {} for name in DETECTOR_LISTS}
    for name, nodes in by_list.items():
        for label in vocabulary(name):
            if label.node_id is not None:
                nodes.setdefault(plain_fold(label.label), set()).add(label.node_id)
    votes: defaultdict[str, dict[str, float]] = defaultdict(dict)
    for name, nodes in by_list.items():
        for form, meant in nodes.items():
            for node_id in sorted(meant):
                votes[form][node_id] = votes[form].get(node_id, 0.0) + LABEL_WEIGHT.get(name, LABEL_WEIGHT_ELSEWHERE)
    # such a word is ambiguous, unless it is in one of the first two lists, whose labels are unambiguous
    clear = {form for name in DETECTOR_LISTS[:2] for form in by_list[name]}
    ambiguous = {form for nodes in by_list.values() for form, meant in nodes.items() if len(meant) > 1}
    return dict(votes) | {form: dict.fromkeys(votes[form], LABEL_WEIGHT_ELSEWHERE) for form in ambiguous - clear}


def _value(table: str, key: str, separator: str = "\t") -> str:
    """Return the line of a key in a table without the key; empty if there is none."""
    text = _text(table)
    _SEARCHES[table] += 1
    is_indexed = _SEARCHES[table] > MAX_SCANS
    start = _line_starts(table, separator).get(key, -1) if is_indexed else text.find(f"\n{key}{separator}")
    return text[start + len(key) + 2 : text.find("\n", start + 1)] if start >= 0 else ""


@cache
def _line_starts(table: str, separator: str) -> dict[str, int]:
    """Return the index of the first line of each key in the text of a table."""
    starts: dict[str, int] = {}
    for line in re.finditer(rf"\n([^\n{separator}]*){separator}", _text(table)):
        starts.setdefault(line[1], line.start())
    return starts


@cache
def _text(table: str) -> str:
    file: Path = taxonomy_directory() / table
    return "\n" + file.read_text(encoding="utf-8") if file.is_file() else "\n"
