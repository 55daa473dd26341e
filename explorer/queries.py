"""Searches as people type them: a question (`how tall is a door`), a name with a size (`tv 55 inch`), or a name.

The browser applies the same patterns (`explorer.search_index`), so that it finds what the server finds.
"""

from __future__ import annotations

import re

from explorer.catalogue import ReleaseCatalogue
from explorer.everyday_sizes import all_axes_text
from explorer.responses import labels_by_list, medians, shown_name, tree_reference
from explorer.schemas import SearchAnswer, SearchHit, SearchQuery
from metric_base.errors import InputError
from metric_tree.node import UnknownName
from taxonomy.words.spelling import plain_fold

_SIZES = r"(?:sizes?|height|width|length|depth|dimensions?|diameter|thickness|measurements?)"
#: Beginnings and ends of a folded text that are about a size; the syntax of Python and JavaScript is the same here.
LEADING = (
    r"^(?:how (?:tall|high|wide|long|deep|big|large|thick|heavy) (?:is|are)|what (?:is|are)|"
    rf"average|standard|typical|normal|{_SIZES} of|the|an?) "
)
TRAILING = rf" (?:{_SIZES}|\d+|in|inch|inches|cm|mm|m|ft|feet)$"


def searched_text(catalogue: ReleaseCatalogue, query: str) -> str:
    """Return the folded text of a query without words about sizes; a name of the release is kept as it is."""
    text = plain_fold(query)
    while text not in catalogue.names:
        shorter = re.sub(LEADING, "", text) if re.search(LEADING, text) else re.sub(TRAILING, "", text)
        if shorter == text:
            break
        text = shorter
    return text


def search_response(catalogue: ReleaseCatalogue, query: SearchQuery) -> SearchAnswer:
    """Return the nodes for a text, the most likely first, and a sentence about the first one if the text is its name.

    Raises
    ------
    InputError
        The text is blank.
    """
    if not query.q.strip():
        raise InputError("q: expected a text; found spaces only")
    text = searched_text(catalogue, query.q)
    nodes = catalogue.tree.search(text or query.q, query.limit)
    answer = None
    try:
        meant = catalogue.tree.resolve(text, advice=False).node
    except UnknownName:
        meant = None
    if meant is not None and catalogue.dims(meant):
        answer = f"{shown_name(meant)}: {all_axes_text(meant, medians(catalogue, meant))}."
    hits = [
        SearchHit(
            node.node_id,
            node.name,
            list(node.path),
            catalogue.tier(node),
            node.n_items,
            {dim: float(f"{mm:.5g}") for dim, mm in medians(catalogue, node).items()},
            labels_by_list(catalogue, node),
        )
        for node in nodes
    ]
    return SearchAnswer(tree=tree_reference(catalogue.tree), query=query.q, answer=answer, hits=hits)
