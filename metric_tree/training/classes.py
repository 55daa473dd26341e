"""The classes of a training set, and which of them a label of another data set is, by the tree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from metric_base.errors import InputError
from metric_tree.node import Node, UnknownName
from metric_tree.tree import Tree


class Classes:
    """The chosen nodes in the order of their ids 1, 2, ...; `ambiguous` counts labels that are too wide to tell.

    Parameters
    ----------
    tree : where labels are looked up
    nodes : the chosen nodes, none above or below another

    Raises
    ------
    InputError
        One node lies below another: its images would be of both classes.
    """

    def __init__(self, tree: Tree, nodes: Sequence[Node]) -> None:
        self.tree, self.nodes = tree, tuple(nodes)
        self._id = {node.node_id: number for number, node in enumerate(self.nodes, start=1)}
        self._above: dict[str, str] = {}
        for node in self.nodes:
            for above in _above(node):
                if above.node_id in self._id:
                    raise InputError(
                        f"categories: expected none below another; found {node.node_id} below {above.node_id}"
                    )
                self._above[above.node_id] = node.node_id
        self._known: dict[tuple[tuple[str, ...], tuple[str, ...]], int | None] = {}
        self.ambiguous: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self.nodes)

    def of_node(self, node: Node | None) -> int | None:
        """The class of a node: its own, or that of the chosen node above it; None if no such node is chosen."""
        for one in [] if node is None else [node, *_above(node)]:
            if one.node_id in self._id:
                return self._id[one.node_id]
        return None

    def of_label(self, names: tuple[str, ...], lists: tuple[str, ...]) -> int | None:
        """The class of a label: read as the lists read it, else by the tree's own names.

        A label above a chosen node (seat, where chairs are chosen) may or may not be of the class: it is left out and
        counted.
        """
        key = (names, lists)
        if key not in self._known:
            self._known[key] = self._look_up(names, lists)
        if self._known[key] == 0:
            self.ambiguous[names[0]] += 1
        return self._known[key] or None

    def categories(self) -> list[dict[str, object]]:
        """COCO's `categories`; the supercategory is the name at the tree's second level."""
        return [
            {"id": number, "name": node.name, "supercategory": node.path[:2][-1], "node_id": node.node_id}
            for number, node in enumerate(self.nodes, start=1)
        ]

    def _look_up(self, names: Iterable[str], lists: Iterable[str]) -> int | None:
        """The class, 0 where the label is above one, None where it has nothing to do with any."""
        for name in names:
            node = _lookup(self.tree, name, (*lists, None))
            if node is not None:
                return self.of_node(node) or (0 if node.node_id in self._above else None)
        return None


def _lookup(tree: Tree, name: str, lists: Iterable[str | None]) -> Node | None:
    for vocabulary in lists:
        try:
            return tree.find(name, vocabulary)
        except (UnknownName, InputError):
            continue
    return None


def _above(node: Node) -> list[Node]:
    """The nodes above, nearest first."""
    line = []
    above = node.parent
    while above is not None:
        line.append(above)
        above = above.parent
    return line
