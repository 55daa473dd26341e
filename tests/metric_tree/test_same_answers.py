"""Names, searches, priors and sentences of release 4.0.0 are those that they were; see `tests/support/same_numbers.py`.

`python -m tests.metric_tree.test_same_answers` writes the files again if a change is intended.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import metric_tree
from metric_base.errors import InputError
from metric_tree.node import Node
from metric_tree.prior import has_distinct_components
from metric_tree.reports.description import everyday_sentence, is_heterogeneous, node_sentence
from metric_tree.tree import Tree
from tests.support.same_numbers import assert_equal_numbers, rounded, write_numbers

ANSWERS, NUMBERS = (Path(__file__).with_name(f"same_answers{suffix}") for suffix in (".txt", ".json"))
#: Every so manieth name and node of the release.
NAME_STEP, NODE_STEP = 97, 41
PHRASES = (
    "black wooden chairs", "pair of scissors", "couch/sofa", "man riding a horse", "electric car",
    "glass bowl (kitchen)",
    "miniature horse", "photo of a chair", "picture of a dog", "statue of a lion", "furniture.seat.chair", "Stuhl",
    "bat", "crane", "mouse (computer)", "mouse (animal)", "orange", "chicken", "nail", "blue whale", "coffe table",
    "tabel", "chiar", "bok", "pencl", "stocking", "big red fire engine", "kitchen sink cabinet", "office swivel chair",
    "person in a chair", "two cups", "cup with a straw", "wardrob", "zzzz", "tvs", "T.V.", "dining-table", "n03001627",
)  # fmt: skip


@cache
def tree() -> Tree:
    return metric_tree.open("4.0.0")


def answer(text: str) -> str:
    """The node of a text, the rule, its margin and the alternatives; or the class of the error and its suggestions."""
    try:
        found = tree().resolve(text)
    except InputError as error:
        return f"{type(error).__name__}: {error}"
    others = " ".join(node.node_id for node in found.alternatives[:3])
    note = f" [{found.note}]" if found.note else ""
    return f"{found.node.node_id}, {found.how}, {found.margin:.3g}, {found.ambiguous}, {others}{note}"


def texts() -> list[str]:
    """Names of the release, some with a letter less or two letters exchanged, and phrases."""
    names = sorted(name for name, _ in tree().names())[::NAME_STEP]
    shorter = [name[: len(name) // 2] + name[len(name) // 2 + 1 :] for name in names[::3]]
    exchanged = [name[:2] + name[3:4] + name[2:3] + name[4:] for name in names[1::3]]
    return [*PHRASES, *names, *shorter, *exchanged]


def nodes() -> list[Node]:
    return [node for node in tree() if node.prior_dims][::NODE_STEP]


def answers() -> list[str]:
    lines = [f"{text}: {answer(text)}" for text in texts()]
    lines += [f"search {text}: {' '.join(node.node_id for node in tree().search(text, 8))}" for text in PHRASES[::2]]
    for node in nodes():
        prior = node.prior()
        kinds = f"{prior.tier}, {is_heterogeneous(node, prior)}, {has_distinct_components(prior)}"
        lines.append(f"{node.node_id}: {kinds}: {node_sentence(node, node.name, prior)}")
        lines.append(everyday_sentence(node.name, prior))
    return lines


def prior_numbers() -> dict[str, list[float]]:
    """Quantiles, spread and disagreement of the priors of some nodes, and their medians in two contexts."""
    numbers = {}
    for node in nodes():
        prior = node.prior()
        row = [*prior.quantiles((0.05, 0.5, 0.95)).ravel(), *prior.log_sd(), *prior.disagreement().ravel()]
        for where in ("region=europe,year=1960", "region=china,year=2020"):
            row += [*node.prior(where=where).quantile(0.5)]
        numbers[node.node_id] = rounded(row)
    return numbers


def test_names_searches_and_sentences_are_those_that_they_were() -> None:
    assert answers() == ANSWERS.read_text(encoding="utf-8").splitlines()


def test_priors_have_the_quantiles_that_they_had() -> None:
    assert_equal_numbers(prior_numbers(), json.loads(NUMBERS.read_text())["priors"])


if __name__ == "__main__":
    ANSWERS.write_text("\n".join(answers()) + "\n", encoding="utf-8")
    write_numbers(NUMBERS, {"priors": prior_numbers()})
