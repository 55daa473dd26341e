"""A taxonomy of six leaves for tests of the build, in a module that worker processes can import."""

from __future__ import annotations

from crawler.items import RawItem
from taxonomy.categories import Category, Match, Pose

_NODES: tuple[tuple[str, str | None, int, Pose], ...] = (  # name, parent, level, pose
    ("entity", None, 1, "upright"),
    ("artifact", "entity", 2, "upright"),
    ("furniture", "artifact", 3, "upright"),
    ("device", "artifact", 3, "flat"),
    ("seat", "furniture", 4, "upright"),
    ("table", "furniture", 4, "upright"),
    ("handset", "device", 4, "flat"),
    ("toy", "device", 4, "any"),
    ("chair", "seat", 5, "upright"),
    ("stool", "seat", 5, "upright"),
    ("sofa", "seat", 5, "upright"),
    ("desk", "table", 5, "upright"),
    ("phone", "handset", 5, "flat"),
    ("ball", "toy", 5, "any"),
)


class SmallTaxonomy:
    """A taxonomy that matches the last word of the category path with the leaf of the same name."""

    def __init__(self) -> None:
        paths: dict[str, tuple[str, ...]] = {}
        self._categories: list[Category] = []
        for name, parent, level, pose in _NODES:
            paths[name] = (*paths.get(parent or "", ()), name)
            self._categories.append(
                Category(
                    node_id=f"{name}.n.01",
                    name=name,
                    synset=f"{name}.n.01",
                    parent_id=f"{parent}.n.01" if parent else None,
                    level=level,
                    path=paths[name],
                    pose=pose,
                )
            )
        self._leaves = {category.name: category.node_id for category in self._categories if category.level == 5}

    def categories(self) -> list[Category]:
        return self._categories

    def match(self, item: RawItem) -> Match:
        node_id = self._leaves.get(item.category_path[-1] if item.category_path else "")
        return Match(node_id, 1.0 if node_id else 0.0, "name" if node_id else "unknown")


def small_taxonomy() -> SmallTaxonomy:
    return SmallTaxonomy()
