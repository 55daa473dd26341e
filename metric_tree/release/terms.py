"""Terms of a release: the licence of the work of the project, and the sources on which the priors rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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
