"""Label lists of detectors and benchmarks: one reviewed table per list, from label to node and from number to label.

The synsets that lists contain are only hints (ScanNet assigns the synset of a bed to its mattress), so each row states
the reason for its node. The first column names the origin of the labels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from metric_base.errors import UnknownKey
from metric_base.folders import taxonomy_directory
from metric_base.parsing import table_rows
from metric_base.spelling import near_spellings
from taxonomy.levels import BadLevels, replaced_ids

#: Reason of labels without a size (walls, floors, skies), which need no prior.
STUFF = "stuff"
#: Prefix of the reason of labels that are not objects (noise, the car of the camera, the rest).
VOID = "void"
#: Reason of labels of items without a node in the tree.
NO_NODE = "no node"
#: Maximum number of labels of similar spelling in a message.
MAX_SUGGESTIONS = 3
_FOLDER = "vocabularies"
_COLUMNS = ("list", "label", "node_id", "reason")
#: Unused ones of the 90 category ids of COCO, which torchvision uses as labels.
COCO_91_GAPS = frozenset({12, 26, 29, 30, 45, 66, 68, 69, 71, 83})


class UnknownLabel(UnknownKey):
    """An unknown list, an unknown label of a list, or a label without a size."""


@dataclass(frozen=True, slots=True)
class Label:
    """A label of a list."""

    label: str
    node_id: str | None  #: None if the label has no size or the tree has no node for it.
    reason: str

    @property
    def needs_prior(self) -> bool:
        """Return True if the label names an item, and is neither stuff nor void."""
        return self.reason != STUFF and not self.reason.startswith(VOID)


@cache
def vocabularies(directory: Path | None = None) -> tuple[str, ...]:
    """Return the names of the available lists, such as `coco_80`."""
    folder = (directory or taxonomy_directory()) / _FOLDER
    return tuple(sorted(path.stem for path in folder.glob("*.csv")))


@cache
def vocabulary(name: str, directory: Path | None = None) -> tuple[Label, ...]:
    """Return the labels of a list, in order; removed ids are replaced by their successors.

    Raises
    ------
    UnknownLabel
        The list does not exist.
    """
    if name not in vocabularies(directory):
        raise UnknownLabel(f"vocabulary: expected one of {', '.join(vocabularies(directory))}; found {name!r}")
    rows = table_rows((directory or taxonomy_directory()) / _FOLDER / f"{name}.csv", _COLUMNS, BadLevels)
    replaced = replaced_ids(directory)
    return tuple(
        Label(row["label"], replaced.get(row["node_id"], row["node_id"]) or None, row["reason"]) for _, row in rows
    )


def label_of(label: str, name: str) -> Label | None:
    """Return the row of a label in a list, or None; case, `_` and `-` are ignored."""
    return _index(name).get(_fold(label))


def labelled_node(label: str, name: str, meant: Callable[[str], Sequence[str]] | None = None) -> str:
    """Return the node of a label.

    Parameters
    ----------
    label : str
        Label; case, `_` and `-` are ignored. Of synonyms separated by commas, as in ADE20K ("screen door, screen"), the
        first that is a label is used.
    name : str
        Name of the list.
    meant : callable, optional
        Return the ids of the nodes of a plain name, for suggestions.

    Raises
    ------
    UnknownLabel
        The list or the label does not exist, or the label has no node.
    """
    row = label_of(label, name)
    for part in label.split(","):
        row = row or label_of(part, name)
    if row is None or (row.node_id is None and row.reason == NO_NODE):
        # labels of the same node, or of the word with a meaning (`bow_(weapon)`), else of a similar spelling
        rows, node_ids, key = vocabulary(name), meant(label) if meant else (), _fold(label)
        same = [row.label for row in rows if row.node_id is not None and row.node_id in node_ids]
        senses = [row.label for row in rows if "_(" in row.label and _fold(row.label.split("_(")[0]) == key]
        forms = [form for form, one in _index(name).items() if one.node_id is not None]
        similar = near_spellings(key, forms, n=MAX_SUGGESTIONS) if not same and not senses else []
        near = list(dict.fromkeys(senses + same)) or [_index(name)[form].label for form in similar]
        problem = f": no label of {name}" if row is None else f" of {name} names nothing that the tree has a node for"
        raise UnknownLabel(f"{label!r}{problem}; nearest: {', '.join(near) or 'nothing like it'}")
    if row.node_id is None:
        raise UnknownLabel(f"{label!r} of {name} has no size of its own: {row.reason}")
    return row.node_id


@cache
def _index(name: str) -> dict[str, Label]:
    index: dict[str, Label] = {}
    for label in vocabulary(name):
        index.setdefault(_fold(label.label), label)
    return index


def _fold(label: str) -> str:
    return " ".join("".join(c if c.isalnum() else " " for c in label.casefold()).split())


def label_names(name: str) -> tuple[str, ...]:
    """Return names by label number: the category ids of COCO for `coco_91`, else the labels of a list from 1."""
    if name != "coco_91":
        return ("", *(label.label for label in vocabulary(name)))
    remaining = iter(vocabulary("coco_80"))
    return ("", *("" if number in COCO_91_GAPS else next(remaining).label for number in range(1, 91)))
