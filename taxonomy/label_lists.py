"""What the label lists of detectors and benchmarks mean: one reviewed table per list, label to node.

A list's own synset is a hint, not an answer (ScanNet gives its mattress the synset of a bed): each row says why the
node was taken. Labels themselves are facts about the lists; the first column names their origin.

The names that a detector's numbers stand for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from metric_base.errors import InputError
from metric_base.folders import taxonomy_directory
from metric_base.parsing import table_rows
from metric_base.spelling import near_spellings
from taxonomy.levels import BadLevels, replaced_ids

#: Reason of labels that have no size of their own (walls, floors, skies), so that they need no prior.
STUFF = "stuff"
#: Begins the reason of labels that name no object (noise, the camera's own car, everything else).
VOID = "void"
#: Reason of labels of items for which the tree has no node.
NO_NODE = "no node"
#: As many labels as a message names that are like one that is not in the list.
NEAREST = 3
_FOLDER = "vocabularies"
_COLUMNS = ("list", "label", "node_id", "reason")
#: COCO's category ids run to 90, of which these ten name nothing; torchvision's labels are these ids.
COCO_91_GAPS = frozenset({12, 26, 29, 30, 45, 66, 68, 69, 71, 83})


class UnknownLabel(InputError, KeyError):
    """An unknown list, a label that is not in the list, or one that names nothing with a size."""

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True, slots=True)
class Label:
    """A label of a list; `node_id` is None if it names nothing with a size, and `reason` says why."""

    label: str
    node_id: str | None
    reason: str

    @property
    def needs_prior(self) -> bool:
        """Return True if it names an item: stuff and void labels do not."""
        return self.reason != STUFF and not self.reason.startswith(VOID)


@cache
def vocabularies(directory: Path | None = None) -> tuple[str, ...]:
    """Names of the available lists, such as `coco_80`."""
    folder = (directory or taxonomy_directory()) / _FOLDER
    return tuple(sorted(path.stem for path in folder.glob("*.csv")))


@cache
def vocabulary(name: str, directory: Path | None = None) -> tuple[Label, ...]:
    """The labels of a list, in its order; an id that is gone gives way to its successor.

    Raises
    ------
    UnknownLabel
        There is no such list.
    """
    if name not in vocabularies(directory):
        at_hand = ", ".join(vocabularies(directory))
        raise UnknownLabel(f"vocabulary: expected one of {at_hand}; found {name!r}")
    rows = table_rows((directory or taxonomy_directory()) / _FOLDER / f"{name}.csv", _COLUMNS, BadLevels)
    replaced = replaced_ids(directory)
    return tuple(
        Label(row["label"], replaced.get(row["node_id"], row["node_id"]) or None, row["reason"]) for _, row in rows
    )


def label_of(label: str, name: str) -> Label | None:
    """The row of a label in a list, or None where it has no such label; case, `_` and `-` are folded."""
    return _index(name).get(_fold(label))


def labelled_node(label: str, name: str, meant: Callable[[str], Sequence[str]] | None = None) -> str:
    """The node that a label means in a list; case, `_` and `-` are folded.

    Official names of ADE20K join synonyms by commas ("screen door, screen"): the first that is a label counts.

    Parameters
    ----------
    label, name : the label and its list
    meant : ids of the nodes with a plain name; the message for a label that is not there names theirs

    Raises
    ------
    UnknownLabel
        No such list or label, or the label needs no prior.
    """
    row = label_of(label, name)
    for part in label.split(","):
        row = row or label_of(part, name)
    if row is None:
        near = ", ".join(_nearest(label, name, meant(label) if meant else ())) or "nothing like it"
        raise UnknownLabel(f"{label!r}: no label of {name}; nearest: {near}")
    if row.node_id is None and row.reason == NO_NODE:
        raise UnknownLabel(f"{label!r} of {name} names nothing that the tree has a node for")
    if row.node_id is None:
        raise UnknownLabel(f"{label!r} of {name} has no size of its own: {row.reason}")
    return row.node_id


def _nearest(label: str, name: str, node_ids: Sequence[str]) -> list[str]:
    """Labels of the same node, else of the word with a meaning (`bow_(weapon)`), else of a like spelling."""
    rows = vocabulary(name)
    same = [row.label for row in rows if row.node_id is not None and row.node_id in node_ids]
    senses = [row.label for row in rows if "_(" in row.label and _fold(row.label.split("_(")[0]) == _fold(label)]
    if same or senses:
        return list(dict.fromkeys(senses + same))
    like = near_spellings(_fold(label), _index(name), n=NEAREST)
    return [_index(name)[key].label for key in like]


@cache
def _index(name: str) -> dict[str, Label]:
    index: dict[str, Label] = {}
    for label in vocabulary(name):
        index.setdefault(_fold(label.label), label)
    return index


def _fold(label: str) -> str:
    return " ".join("".join(c if c.isalnum() else " " for c in label.casefold()).split())


def label_names(name: str) -> tuple[str, ...]:
    """Names by label number: `coco_91` for COCO's own ids, else a shipped list counted from 1."""
    if name != "coco_91":
        return ("", *(label.label for label in vocabulary(name)))
    remaining = iter(vocabulary("coco_80"))
    return ("", *("" if number in COCO_91_GAPS else next(remaining).label for number in range(1, 91)))
