"""What a person's name for an object means in the tree, while it is typed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from estimator.results.categories import LabelMeaning, meanings
from metric_tree.tree import Tree

__all__ = ["ObjectNames"]

#: Names that are offered for what was typed.
OFFERED = 8


@dataclass(frozen=True, slots=True, eq=False)
class ObjectNames:
    """The names of a tree, read as the labels of a detector are."""

    tree: Tree

    def __call__(self, text: str) -> dict[str, Any]:
        """Whether the name is known, a sentence about it, and names that begin like it or mean something near it."""
        meaning = meanings(self.tree, {text})[text]
        offers = [node.name for node in self.tree.search(text, OFFERED)]
        return {"known": meaning.prior is not None, "says": _sentence(meaning), "offers": list(dict.fromkeys(offers))}


def _sentence(meaning: LabelMeaning) -> str:
    """The node with its median size, or why there is none."""
    if meaning.node is None or meaning.prior is None:
        return str(meaning.reason)
    middle = meaning.prior.quantile(0.5) / 1000
    sizes = ", ".join(f"{name} {size:.2g} m" for name, size in zip(meaning.prior.dims, middle, strict=True))
    notes = "".join(f"; {note}" for note in meaning.notes)
    return f"{meaning.node.name}: usually {sizes}{notes}"
