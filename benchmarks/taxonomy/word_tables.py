"""Write the tables of words that the resolver reads: `python -m benchmarks.taxonomy.word_tables`.

`data/taxonomy/senses.tsv` has a line for each noun of WordNet with a sense that is a thing, and for each name of an
inserted category: the word, then its senses in WordNet's order, each as `count:node>node`, where `count` is how often
WordNet's tagged texts use the word so and the nodes are the concept's own node and those above it, nearest first.

`data/taxonomy/heads.tsv` says how far a head noun can be trusted: of the known compounds that end in the word (`car
door`, `barn door`), how many are things of each node that the word alone names. A gas pump is a pump; few plugs are.

`data/taxonomy/near_words.txt` has the English words, with the forms of verbs, that are one letter off a word of a name
without being one: `tunnel` is not a misspelt `funnel`.

`data/taxonomy/codes.tsv` has the ids of label lists: ImageNet's `n02119789`, Open Images' `/m/01mzpv`.

The tables change when WordNet, the leaves or the aliases do; they hold no word that a benchmark asks for by itself.
"""

from __future__ import annotations

import argparse
import csv
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

from metric_base.folders import taxonomy_directory
from taxonomy.catalogue import OTHER, Catalogue, default_catalogue
from taxonomy.label_lists import vocabulary
from taxonomy.wordnet import WordNet, default_wordnet
from taxonomy.words.spelling import fold_text, one_edit

#: Steps up from a concept to a node that still says enough of its size.
STEPS = 4

#: Nodes above this level say too little.
LEAST_LEVEL = 3

#: Compounds of a head word before anything is said of it.
LEAST_COMPOUNDS = 3

#: Letters of a word that may be misspelt.
LEAST_NEAR = 5

#: How WordNet marks the senses that insult people. They are no names of things, and are not shipped.
INSULTS = re.compile(
    r"ethnic slur|offensive (?:term|name|word)|\(offensive\)|derogatory|disparaging|obscene|thoroughly disliked"
)


class Chains:
    """Nodes of a concept and above it, nearest first."""

    def __init__(self, catalogue: Catalogue, wordnet: WordNet) -> None:
        self._catalogue = catalogue
        self._wordnet = wordnet
        self._levels = {one.node_id: one.level for one in catalogue.categories}
        self._memory: dict[str, tuple[str, ...]] = {}

    def of(self, concept: str) -> tuple[str, ...]:
        """The nodes of a concept: its own, then those of what is above it."""
        if concept not in self._memory:
            self._memory[concept] = self._of(concept)
        return self._memory[concept]

    def _of(self, concept: str) -> tuple[str, ...]:
        at = self._catalogue.successors.get(concept, concept)
        chain = [at] if self._levels.get(at, 0) >= LEAST_LEVEL else []
        leaf = self._catalogue.leaves.get(at)
        above = leaf.hypernym if leaf is not None and leaf.hypernym else at
        if above.startswith("mt:"):
            return tuple(dict.fromkeys((*chain, *(self.of(above) if above != at else ()))))
        upward = ([above] if above != at else []) + list(self._near(above))
        chain += [node for node in upward if self._levels.get(node, 0) >= LEAST_LEVEL]
        return tuple(dict.fromkeys(chain))

    def _near(self, synset: str) -> Iterator[str]:
        level: tuple[str, ...] = (synset,)
        for _ in range(STEPS):
            level = tuple(dict.fromkeys(above for one in level for above in self._wordnet.parents(one)))
            yield from level


def sense_lines(catalogue: Catalogue, wordnet: WordNet) -> dict[str, list[tuple[int, tuple[str, ...]]]]:
    """Senses of every word with at least one that is a thing: how often each is meant, and its nodes."""
    chains = Chains(catalogue, wordnet)
    lines: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
    for noun in sorted(wordnet.nouns):
        general = [sense for sense in wordnet.senses(noun) if not wordnet.is_instance(sense)]
        decent = [sense for sense in general if not INSULTS.search(wordnet.definition(sense))]
        senses = [(wordnet.tagged_count(sense, noun), chains.of(sense)) for sense in decent]
        if any(nodes for _, nodes in senses):
            lines.setdefault(fold_text(noun), []).extend(senses)
    for category in catalogue.categories:
        if category.node_id.startswith("mt:") and not category.node_id.endswith(OTHER):
            for name in (category.name.partition(" (")[0], *category.aliases):
                chain = chains.of(category.node_id)
                line = lines.setdefault(fold_text(name), [])
                if chain and not any(nodes[:1] == chain[:1] for _, nodes in line):
                    line.append((0, chain))
    return {word: line for word, line in lines.items() if word and line}


def head_lines(lines: dict[str, list[tuple[int, tuple[str, ...]]]]) -> Iterator[tuple[str, str, int, int]]:
    """(head word, node, compounds that are kinds of the node, compounds) of words that end three compounds or more."""
    compounds: defaultdict[str, list[set[str]]] = defaultdict(list)
    for phrase, senses in lines.items():
        before, _, head = phrase.rpartition(" ")
        if before and head in lines:
            compounds[head].append({node for _, nodes in senses[:1] for node in nodes})
    for head in sorted(compounds):
        kinds = Counter(node for nodes in compounds[head] for node in nodes)
        own = {nodes[0] for _, nodes in lines[head] if nodes}
        if len(compounds[head]) >= LEAST_COMPOUNDS:
            yield from ((head, node, kinds[node], len(compounds[head])) for node in sorted(own) if kinds[node])


def near_words(names: Iterable[str], wordnet: WordNet) -> list[str]:
    """English words that are one letter off a word of a name and are not a word of one."""
    spelt = {word for name in names for word in name.split() if len(word) >= LEAST_NEAR - 1}
    by_hole: defaultdict[str, set[str]] = defaultdict(set)
    for word in spelt:
        for hole in _holes(word):
            by_hole[hole].add(word)
    inflected = {word.removesuffix("e") + "ing" for word in wordnet.words} | {f"{word}s" for word in wordnet.words}
    english = wordnet.words | inflected | {word.removesuffix("e") + "ed" for word in wordnet.words}
    candidates = (word for word in english - spelt if len(word) >= LEAST_NEAR)
    return sorted(
        word for word in candidates if any(one_edit(word, one) for hole in _holes(word) for one in by_hole[hole])
    )


def _holes(word: str) -> set[str]:
    """A word, and the word without each of its letters: two words that are one edit apart share one of them."""
    return {word, *(word[:at] + word[at + 1 :] for at in range(len(word)))}


def code_lines(files: dict[str, Path | None]) -> Iterator[tuple[str, str]]:
    """(code, node) of the labels of lists whose own tables are given: rows `id,name,code` in the list's order."""
    for name, file in files.items():
        if file is not None:
            with file.open(encoding="utf-8", newline="") as rows:
                codes = [row[2] for row in list(csv.reader(rows))[1:]]
            for code, label in zip(codes, vocabulary(name), strict=True):
                if label.node_id:
                    yield code, label.node_id


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--openimages", type=Path, help="Open Images' classes as id,name,mid")
    parser.add_argument("--imagenet", type=Path, help="ImageNet's classes as id,name,synset offset")
    arguments = parser.parse_args()
    lists = {"imagenet_1k": arguments.imagenet, "openimages_601": arguments.openimages}
    catalogue, wordnet = default_catalogue(), default_wordnet()
    lines = sense_lines(catalogue, wordnet)
    folder = taxonomy_directory()
    written = [
        f"{word}\t" + ";".join(f"{count}:{'>'.join(nodes)}" for count, nodes in lines[word]) for word in sorted(lines)
    ]
    (folder / "senses.tsv").write_text("\n".join(written) + "\n", encoding="utf-8")
    heads = ["\t".join(map(str, row)) for row in head_lines(lines)]
    (folder / "heads.tsv").write_text("\n".join(heads) + "\n", encoding="utf-8")
    names = (fold_text(name) for one in catalogue.categories for name in (one.name, *one.aliases))
    (folder / "near_words.txt").write_text("\n".join(near_words(names, wordnet)) + "\n", encoding="utf-8")
    print(f"{len(written)} words, {len(heads)} heads")
    if all(lists.values()):  # without the lists' own tables the codes stay as they are
        codes = ["\t".join(row) for row in sorted(set(code_lines(lists)))]
        (folder / "codes.tsv").write_text("\n".join(codes) + "\n", encoding="utf-8")
        print(f"{len(codes)} codes")


if __name__ == "__main__":
    main()
