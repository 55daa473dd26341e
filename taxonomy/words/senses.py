"""What a word means: its senses in WordNet, their reviewed order, trust in head nouns, codes and labels of detectors.

`python -m data.generate words` writes all tables but two, which a reviewer (a program: a language model)
writes: `meanings.csv`, the words that several nodes share, with the nodes in the order in which people mean them, and
`other_names.csv`, names in other languages and names of norms. The tables are read on demand, each once, as text that
is searched: a first answer must not wait for fifty thousand lines to be parsed.
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
from taxonomy.words.spelling import is_american, plain_fold, without_accents

# A scan of the longest table takes a millisecond, its index 40: it is made for those who ask often.
MAX_SCANS = 50
_ASKED: Counter[str] = Counter()

#: Label lists in the order in which a detector's word is looked up: the most used detectors first.
DETECTOR_LISTS = (
    "coco_80", "lvis_v1", "openimages_601", "objects365_v2", "ade20k_150", "scannet200", "omni3d_50", "sunrgbd_10",
    "nuscenes_32", "kitti_8", "cityscapes_35", "waymo_4", "argoverse2_30", "mapillary_vistas_66", "things_1854",
    "matterport_1659", "imagenet_1k",
)  # fmt: skip

#: Weight of a list's word; the four lists that most detectors are trained on, and any other.
LABEL_WEIGHT = {"coco_80": 3.0, "lvis_v1": 2.0, "openimages_601": 2.0, "objects365_v2": 2.0}
LABEL_WEIGHT_ELSEWHERE = 0.7


#: How umlauts are written without them: `Kuehlschrank`.
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue"})


@dataclass(frozen=True, slots=True)
class Sense:
    """One sense of a word: `chain` is its concept and those above, nearest first; empty where it is not an object.

    `count` is how often WordNet's tagged texts use the word so.
    """

    chain: tuple[str, ...]
    count: int = 0

    @property
    def concept(self) -> str:
        """What is meant."""
        return self.chain[0]

    def is_a(self, kinds: Iterable[str]) -> bool:
        """Return True if the concept is one of the kinds or below one."""
        return any(kind in self.chain for kind in kinds)


class Meanings(NamedTuple):
    """The nodes that share a word, in a reviewer's order; `clear` if the first is meant nearly always."""

    nodes: tuple[str, ...]
    clear: bool


def senses(word: str) -> tuple[Sense, ...]:
    """The senses of a folded word in WordNet's order, as nodes of the tree; empty if unknown."""
    line = _value("generated/senses.tsv", word)
    return tuple(_sense(part) for part in line.split(";")) if line else ()


def reviewed_meanings(word: str) -> Meanings | None:
    """The reviewed order of what a folded word means; None for a word that no reviewer has ordered."""
    row = _value("meanings.csv", word, ",")
    if not row:
        return None
    nodes, clear, *_ = row.split(",")
    return Meanings(tuple(nodes.split()), clear == "yes")


def head_trust(head: str) -> dict[str, tuple[int, int]]:
    """By node: how many of the known compounds that end in a word are such items, and how many there are."""
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
    """The node of ImageNet's `n02119789` or Open Images' `/m/01mzpv`; None if the code is unknown."""
    return _value("generated/codes.tsv", code) or None


def is_english(word: str) -> bool:
    """Return True if a folded word is English though no name has it: `tunnel` is not a misspelt `funnel`."""
    return bool(senses(word)) or f"\n{word}\n" in _text("generated/near_words.txt")


def other_names(form: str) -> Mapping[str, str]:
    """By node: the language (`de`, `fr`, `es`, `it`) in which a folded word names it, or `norm` of a norm's name."""
    return _other_names().get(form, {}) if _may_be_other_name(form) else {}


def _may_be_other_name(form: str) -> bool:
    """Return True if the table has the letters of its longest word.

    Folding the whole table would take as long as the rest of a query.
    """
    word = max(form.split(), key=len, default="")
    return _without_umlauts(word) in _other_letters() or is_american(word)


@cache
def _other_letters() -> str:
    cells = "\n".join(line.partition(",")[2] for line in _text("other_names.csv").split("\n"))
    plain = without_accents(cells).encode("ascii", "ignore").decode()
    return _without_umlauts(plain.replace("'", "").replace("`", ""))


def _without_umlauts(text: str) -> str:
    """The same text for either way to write an umlaut."""
    return text.replace("ae", "a").replace("oe", "o").replace("ue", "u")


@cache
def _other_names() -> Mapping[str, Mapping[str, str]]:
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
    """What the reviewed label lists of detectors say of a folded word: weight by node, by how much a list is used."""
    return _votes().get(form, {})


def node_uses() -> dict[str, float]:
    """How much the label lists of detectors use each node: the weights of the lists that have a label for it."""
    uses: dict[str, float] = {}
    for meant in _votes().values():
        for node_id, weight in meant.items():
            uses[node_id] = max(uses.get(node_id, 0.0), weight)
    return uses


def listed_nodes(text: str) -> tuple[str, ...]:
    """The nodes of a detector's label, that of the most used list first."""
    return tuple(label_votes(plain_fold(text)))


@cache
def _votes() -> Mapping[str, dict[str, float]]:
    from taxonomy.label_lists import vocabularies  # most names need no list

    votes: defaultdict[str, dict[str, float]] = defaultdict(dict)
    by_list = {name: _nodes_of_list(name) for name in DETECTOR_LISTS if name in vocabularies()}
    for name, nodes in by_list.items():
        for form, meant in nodes.items():
            for node_id in sorted(meant):
                votes[form][node_id] = votes[form].get(node_id, 0.0) + LABEL_WEIGHT.get(name, LABEL_WEIGHT_ELSEWHERE)
    # a list that has a word twice disputes it, unless one of the two lists has it whose labels were chosen to be clear
    clear = {form for name in DETECTOR_LISTS[:2] for form in by_list.get(name, ())}
    disputed = {form for nodes in by_list.values() for form, meant in nodes.items() if len(meant) > 1}
    return dict(votes) | {form: dict.fromkeys(votes[form], LABEL_WEIGHT_ELSEWHERE) for form in disputed - clear}


def _nodes_of_list(name: str) -> Mapping[str, set[str]]:
    """Nodes of each folded word of a list; two where it has the word twice and means two items (ImageNet's crane)."""
    from taxonomy.label_lists import vocabulary

    nodes: defaultdict[str, set[str]] = defaultdict(set)
    for label in vocabulary(name):
        if label.node_id is not None:
            nodes[plain_fold(label.label)].add(label.node_id)
    return nodes


def _sense(part: str) -> Sense:
    count, _, nodes = part.partition(":")
    return Sense(tuple(nodes.split(">")) if nodes else (), int(count))


def _value(table: str, key: str, separator: str = "\t") -> str:
    text = _text(table)
    _ASKED[table] += 1
    indexed = _ASKED[table] > MAX_SCANS
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
