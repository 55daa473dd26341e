"""The pages about the whole release: home, the tree, about, compare, scale."""

from __future__ import annotations

from typing import Any

from markupsafe import Markup

from explorer.charts.icicle import icicle
from explorer.content.answers import sentence, shown_name
from explorer.content.release_catalogue import ReleaseCatalogue
from explorer.content.tiers import MEANINGS, TIERS
from explorer.pages.templating import page_bytes
from explorer.urls import page_of
from metric_tree.report.changes import label

__all__ = ["about_page", "compare_page", "home_page", "scale_page", "tree_page"]

#: Categories of the home page, those that the release has.
TYPICAL = (
    "chair.n.01", "door.n.01", "mug.n.04", "car.n.01", "person.n.01", "bicycle.n.01", "bottle.n.01", "desk.n.01",
)  # fmt: skip

#: An example for the scale page: objects measured in a scene whose unit is 2 m.
EXAMPLE = {
    "schema": "metric-tree/objects/1",
    "objects": [
        {"id": "chair 1", "category": "chair", "dimensions": {"length": 0.27, "width": 0.26, "height": 0.45}},
        {"id": "table 2", "category": "dining table", "dimensions": {"height": 0.37}},
        {"id": "mug 3", "category": "mug", "dimensions": {"height": 0.049}},
        {"id": "bottle 4", "category": "bottle", "dimensions": {"height": 0.13}},
    ],
}


def home_page(catalogue: ReleaseCatalogue) -> bytes:
    """The first page."""
    nodes = [catalogue.nodes[node_id] for node_id in TYPICAL if node_id in catalogue.nodes]
    counts = dict(catalogue.of_tier())
    return page_bytes(
        catalogue,
        "home.html",
        "",
        "How large are things?",
        counts=catalogue.tree.release.manifest["counts"],
        cards=[
            {
                "name": shown_name(node),
                "href": page_of(node.node_id),
                "tier": catalogue.tier(node),
                "sentence": sentence(catalogue, node),
            }
            for node in nodes
        ],
        realms=[
            {"name": node.name, "href": page_of(node.node_id), "n_items": node.n_items}
            for node in sorted(catalogue.tree.root.children, key=lambda node: -node.n_items)
        ],
        tier_rows=[
            (tier, meaning, counts.get(tier, 0))
            for tier, meaning in MEANINGS.items()
            if tier in TIERS or counts.get(tier)
        ],
        releases=_releases(catalogue),
    )


def tree_page(catalogue: ReleaseCatalogue) -> bytes:
    """The outline of the five levels, and the tree as areas."""
    root = catalogue.tree.root
    areas = Markup(icicle(root, catalogue.tier))
    return page_bytes(catalogue, "tree.html", "", "The tree", top=root, tier=catalogue.tier, areas=areas)


def about_page(catalogue: ReleaseCatalogue) -> bytes:
    """What the sizes and the tiers mean."""
    return page_bytes(catalogue, "about.html", "", "About these sizes")


def compare_page(catalogue: ReleaseCatalogue) -> bytes:
    """Up to six nodes on one axis; the browser draws them from `assets/sizes.js`."""
    return page_bytes(catalogue, "compare.html", "", "Compare")


def scale_page(catalogue: ReleaseCatalogue) -> bytes:
    """Results and measured objects, read in the browser."""
    return page_bytes(catalogue, "scale.html", "", "The scale of a scene", example=EXAMPLE)


def _releases(catalogue: ReleaseCatalogue) -> list[dict[str, Any]]:
    here: dict[str, Any] = {"name": label(catalogue.tree), "href": "index.html", "changes": None}
    others = [
        {"name": label(tree), "href": f"{catalogue.way_to(tree)}index.html", "changes": f"changes/{tree.version}.html"}
        for tree in catalogue.others
    ]
    return [here, *others]
