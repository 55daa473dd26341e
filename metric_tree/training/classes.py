"""Classes of a training set, and the class of a label of another data set, according to the tree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress

from metric_base.errors import InputError
from metric_tree.node import Node
from metric_tree.tree import Tree


class Classes:
    """Chosen nodes, with the class ids 1, 2, ... in their order.

    Parameters
    ----------
    tree : Tree
        Tree that resolves labels.
    nodes : sequence of Node
        Chosen nodes, none of which may be an ancestor of another.

    Attributes
    ----------
    ambiguous : Counter of str
        Number of objects by label whose label is broader than a class.

    Raises
    ------
    InputError
        A node is an ancestor of another: the objects would belong to both classes.
    """

    def __init__(self, tree: Tree, nodes: Sequence[Node]) -> None:
        self.tree, self.nodes = tree, tuple(nodes)
        self._ids = {node.node_id: number for number, node in enumerate(self.nodes, start=1)}
        self._broader: set[str] = set()
        for node in self.nodes:
            for above in node.ancestors():
                if above.node_id in self._ids:
                    found = f"{node.node_id} below {above.node_id}"
                    raise InputError(f"categories: expected none below another; found {found}")
                self._broader.add(above.node_id)
        self._nodes_of_labels: dict[tuple[tuple[str, ...], tuple[str, ...]], Node | None] = {}
        self.ambiguous: Counter[str] = Counter()

    def of_node(self, node: Node) -> int | None:
        """Return the class of a node or of its nearest chosen ancestor, or None."""
        return next((self._ids[one.node_id] for one in (node, *node.ancestors()) if one.node_id in self._ids), None)

    def of_label(self, names: tuple[str, ...], lists: tuple[str, ...]) -> int | None:
        """Return the class of a label, or None.

        A label that is broader than a class (`seat`, if chairs are chosen) has no class and is counted in `ambiguous`.

        Parameters
        ----------
        names : tuple of str
            The label and its synonyms; the first one with a node counts.
        lists : tuple of str
            Label lists of the data set, which precede the names of the tree.
        """
        key = (names, lists)
        if key not in self._nodes_of_labels:
            nodes = (node_of_label(self.tree, name, lists) for name in names)
            self._nodes_of_labels[key] = next((node for node in nodes if node is not None), None)
        node = self._nodes_of_labels[key]
        if node is None:
            return None
        class_id = self.of_node(node)
        if class_id is None and node.node_id in self._broader:
            self.ambiguous[names[0]] += 1
        return class_id

    def categories(self) -> list[dict[str, object]]:
        """Return the `categories` of COCO; the supercategory is the name of the ancestor of level 2."""
        return [
            {"id": number, "name": node.name, "supercategory": node.path[:2][-1], "node_id": node.node_id}
            for number, node in enumerate(self.nodes, start=1)
        ]


def node_of_label(tree: Tree, name: str, lists: Iterable[str]) -> Node | None:
    """Return the node of a label by the first list that contains it, else by the names of the tree, or None."""
    for vocabulary in (*lists, None):
        with suppress(InputError):
            return tree.find(name, vocabulary)
    return None
