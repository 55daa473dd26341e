"""Searches as people type them: a question (`how tall is a door`), a name with a size (`tv 55 inch`), or a name.

A text that means no category (`Tree.resolve`) has no answer; its hits are similar names. The browser applies the same
rules to the index of `explorer.search_index`, so that both find the same categories.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

from msgspec.structs import asdict

from explorer.catalogue import ReleaseCatalogue
from explorer.responses import labels_by_list, reference, size_answer, tree_reference
from explorer.schemas import SearchAnswer, SearchHit, SearchQuery
from metric_base.errors import InputError
from metric_tree.node import Meaning, UnknownName
from taxonomy.words.spelling import plain_fold

_SIZES = r"(?:sizes?|height|width|length|depth|dimensions?|diameter|thickness|measurements?)"
#: Beginnings and ends of a query that are no part of a name. The pattern is valid in Python and in JavaScript.
LEADING = (
    r"^(?:how (?:tall|high|wide|long|deep|big|large|thick|heavy) (?:is|are)|what(?: is| are|'?s)|"
    rf"average|standard|typical|normal|{_SIZES} of|the|an?) "
)
TRAILING = rf" (?:{_SIZES}|\d+|in|inch|inches|cm|mm|m|ft|feet)$"
#: Values of `Meaning.how` for texts that are not a name of the node; the answer then begins with "Taken as".
TAKEN = frozenset({"modifier stripped", "broader kind", "misspelt"})
#: Punctuation at the end of a word, which is removed.
PUNCTUATION = r"[?!;:,.]+(?:\s|$)"


def shorter_texts(query: str) -> Iterator[str]:
    """Yield a query without punctuation, then without one more word about sizes each time."""
    text = " ".join(re.sub(PUNCTUATION, " ", query).split())
    while True:
        yield text
        is_question = re.search(LEADING, text, re.IGNORECASE)
        shorter = re.sub(LEADING if is_question else TRAILING, "", text, flags=re.IGNORECASE)
        if shorter == text:
            return
        text = shorter


def searched_meaning(catalogue: ReleaseCatalogue, query: str) -> tuple[str, Meaning | None]:
    """Return the text of a query without words about sizes, and its meaning if it states a size.

    Words are removed until the text is a name of the release, or states a size as a variant or a number does.
    """
    text = ""
    for text in shorter_texts(query):
        if (meaning := catalogue.tree.stated_meaning(text)) is not None:
            return text, meaning
        if plain_fold(text) in catalogue.names:
            break
    return text, None


def search_response(catalogue: ReleaseCatalogue, query: SearchQuery) -> SearchAnswer:
    """Return the nodes for a text, the most likely first, and a sentence about the first one if the text means it.

    Raises
    ------
    InputError
        The text is blank.
    """
    if not query.q.strip():
        raise InputError("q: expected a text; found spaces only")
    text, meaning = searched_meaning(catalogue, query.q)
    nodes = catalogue.tree.search(text or query.q, query.limit)
    answer = None
    if meaning is None and text:
        with suppress(UnknownName):
            meaning = replace(catalogue.tree.resolve(text, advice=False), node=nodes[0])
    if meaning is not None:
        nodes = (meaning.node, *(node for node in nodes if node.node_id != meaning.node.node_id))[: query.limit]
        answer = size_answer(catalogue, meaning.node, meaning.how in TAKEN)
    hits = [
        SearchHit(**asdict(reference(catalogue, node)), path=list(node.path), labels=labels_by_list(catalogue, node))
        for node in nodes
    ]
    return SearchAnswer(tree=tree_reference(catalogue.tree), query=query.q, answer=answer, hits=hits)
