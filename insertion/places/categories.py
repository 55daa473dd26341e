"""The instances that a person means by the name of a category."""

from __future__ import annotations

from collections.abc import Sequence

from estimator.records.scene import Instance
from insertion.places.place import NoPlace

__all__ = ["instances_named"]


def instances_named(instances: Sequence[Instance], name: str) -> list[Instance]:
    """The instances of a category: by its own name, by its last words ("table" is any "coffee table"), or by the tree.

    In the shipped tree "sofa" is a "couch", and "furniture" is both. Raises NoPlace, with what there is, where nothing
    has the name.
    """
    wanted = name.casefold().strip()
    named = [item for item in instances if item.category.casefold() == wanted]
    named = named or [item for item in instances if item.category.casefold().endswith(f" {wanted}")]
    if named:
        return named
    meant = _meant_by(wanted, sorted({item.category for item in instances}))
    if not meant:
        names = ", ".join(sorted({item.category for item in instances})) or "no instance at all"
        raise NoPlace(f"--on: expected a category of the instances ({names}); found {name!r}")
    return [item for item in instances if item.category in meant]


def _meant_by(wanted: str, categories: Sequence[str]) -> set[str]:
    """The categories whose node of the tree is that of `wanted`, or below it."""
    import metric_tree

    if not categories:
        return set()
    tree = metric_tree.open()
    try:
        above = tree.find(wanted).node_id
    except metric_tree.UnknownName:
        return set()
    meant = set()
    for category in categories:
        try:
            node = tree.find(category)
        except metric_tree.UnknownName:
            continue
        if node.node_id == above or above in node.hypernyms:
            meant.add(category)
    return meant
