"""Terms of a release: licences of its published rows, their attributions, and the sources on which its priors rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pyarrow as pa

from metric_tree.release.release import Release

#: Licence of the tree, its priors, norms and judged ranges, which are the project's own work.
OWN_LICENCE = "Apache-2.0"


def basis(manifest: Mapping[str, Any]) -> str:
    """Return two sentences about the sources of the priors of a release, and the licence of the priors."""
    withheld = [source for source in manifest["sources"] if source.get("withheld")]
    fitted = f"The priors of {manifest['version']} are fitted to {manifest['counts']['n_fit']:,} items"
    licence = f"This project licenses its own work, the priors among it, under {OWN_LICENCE}"
    if not withheld:
        return f"{fitted} of sources with open licences. {licence}."
    n_fit = sum(source["n_fit"] for source in withheld)
    restricted = [source["id"] for source in withheld if source.get("noncommercial")]
    return (
        f"{fitted}, {n_fit:,} of them of {len(withheld)} sources whose rows are not published, because they have no "
        f"open licence or non-commercial terms ({', '.join(restricted) or 'none'}). {licence}; the terms of these "
        "sources may restrict your use of values that were fitted to them. "
        'A release without them is opened by `metric_tree.open(licence="open")`.'
    )


def item_attributions(release: Release, items: pa.Table) -> list[str]:
    """Return the attribution of each published item: its own, that of its image or source, or its title and address."""
    sources = {source["id"]: source for source in release.manifest["sources"]}
    images = release.table("images")
    of_images: dict[str, str] = {}
    if "attribution" in images.column_names:
        pairs = zip(images["item_id"].to_pylist(), images["attribution"].to_pylist(), strict=True)
        of_images = {item_id: text for item_id, text in pairs if text}
    attributions = []
    for row in items.select(["item_id", "source", "title", "licence", "url"]).to_pylist():
        source = sources.get(row["source"], {})
        is_general = source.get("attribution") and " AND " not in str(source.get("licence"))
        own = None if is_general else of_images.get(row["item_id"])
        named = ", ".join(filter(None, (f'"{row["title"]}"', row["licence"], row["url"])))
        attributions.append(own or (source["attribution"] if is_general else named))
    return attributions
