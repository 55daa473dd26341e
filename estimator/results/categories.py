"""What a category name means in the tree, read as detectors mean it: a `mouse` is a device."""

from __future__ import annotations

from dataclasses import dataclass

from metric_base.errors import InputError
from metric_base.spelling import ADVICE
from metric_tree.context import Where
from metric_tree.prior import Prior
from metric_tree.tree import DETECTORS, Node, Tree

__all__ = ["BROADER_SCORE", "LabelMeaning", "meanings"]

#: What is left of the score of an object whose label is read as a broader kind: a foosball table is no usual table, and
#: its chance of being unlike the prior is one in four rather than one in ten.
BROADER_SCORE = 0.7

#: Unknown names for which others are offered: each takes some milliseconds, and nobody reads more of them.
MAX_ADVISED_NAMES = 50


@dataclass(frozen=True, slots=True, eq=False)
class LabelMeaning:
    """The node of a category name and its prior, or the reason why there is none.

    broader : the name says more than the node does, as `foosball table` does of a table.
    """

    node: Node | None
    prior: Prior | None
    reason: str | None = None
    broader: bool = False

    @property
    def error(self) -> str | None:
        """The reason without the names that may be meant: a warning lists them, once."""
        return None if self.reason is None else self.reason.partition(ADVICE)[0]

    @property
    def notes(self) -> tuple[str, ...]:
        """What is said of every object of this name."""
        return (f"read as the broader kind {self.node.name}",) if self.broader and self.node is not None else ()


def meanings(
    tree: Tree, names: set[str], dims: tuple[str, ...] | None = None, where: Where | None = None
) -> dict[str, LabelMeaning]:
    """What each name means. With `dims` the prior is over these alone, else over the node's own.

    With `where` it is that of a region and a year. A name that means no node, or several alike, or a node without
    such a prior, has a reason instead: it is listed, not fatal.
    """
    known: dict[str, LabelMeaning] = {}
    unknown = 0
    for name in sorted(names):
        known[name] = _meaning(tree, name, dims, where, unknown < MAX_ADVISED_NAMES)
        unknown += known[name].node is None
    return known


def _meaning(tree: Tree, name: str, dims: tuple[str, ...] | None, where: Where | None, advice: bool) -> LabelMeaning:
    try:
        node = tree.find(name, DETECTORS, advice=advice)
    except InputError as error:
        return LabelMeaning(None, None, str(error))
    try:
        return LabelMeaning(node, node.prior(dims, where), broader=_is_broader(tree, name, node))
    except InputError as error:
        return LabelMeaning(node, None, str(error))


def _is_broader(tree: Tree, name: str, node: Node) -> bool:
    """Whether a name ends with the name of its node and says more, which is neither an adjective nor a known name."""
    words, own = _words(name), _words(node.name)
    if words == own or words[-len(own) :] != own or any(words == _words(alias) for alias in node.aliases):
        return False
    return tree.resolve(name, DETECTORS).how in {"label list", "broader kind"}


def _words(name: str) -> list[str]:
    return name.lower().replace("_", " ").replace("-", " ").split()
