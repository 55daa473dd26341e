"""From a page to a raw item: which of its facts state the product's size, and what the product is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import groupby

from crawler.dimensions import Length, Size, agreed, sizes
from crawler.embedded import embedded_facts
from crawler.facts import Fact, facts
from crawler.items import RawItem
from crawler.pages import Page, squeezed
from crawler.pages import source_id as hashed_url
from crawler.product import Product, product
from crawler.words import Language, is_component, is_dimension_label, is_package, is_whole, plain

__all__ = ["Statement", "chosen", "raw_item", "statements"]

#: How a statement is to be trusted: a labelled size of the whole, a labelled size, single axes in a table of
#: sizes, single axes elsewhere, what scripts carry, prose.
WHOLE, SIZE, AXES, LOOSE, SCRIPT, PROSE = 5, 4, 3, 2, 1, 0

#: Statements from here up are the page's own word; below it the item is flagged.
TRUSTED = LOOSE


@dataclass(frozen=True, slots=True)
class Statement:
    """One statement of the product's size: the size, how far it is to be trusted, the text it was read from."""

    size: Size
    trust: int
    text: str


def raw_item(page: Page, source: str, found: Product | None = None, now: datetime | None = None) -> RawItem:
    """The raw item of a page; `extents_mm` is None where the page states no product size.

    Parameters
    ----------
    source : the name of the spider that owns the page's site.
    found : what the site's own rules say of the product; what they leave out is read from the page's structured data.
    """
    known = product(page) if found is None else found
    best = chosen(statements(page, known.sizes))
    flags = _flags(best)
    return RawItem(
        source=source,
        source_id=known.id or hashed_url(page.url),
        url=page.url,
        title=known.title,
        category_path=known.category_path,
        brand=known.brand,
        dimensions_text=best.text if best else None,
        dimensions_mm=_words(best.size) if best else {},
        extents_mm=best.size.extents_mm() if best else None,
        images=known.images,
        retrieved_at=(now or datetime.now(UTC)).isoformat(timespec="seconds"),
        flags=flags,
    )


def statements(page: Page, structured: Sequence[tuple[str, str]] = ()) -> list[Statement]:
    """All statements of the product's size on a page; `structured` holds axis and text pairs of schema.org data."""
    visible = list(facts(page))
    found = _labelled(visible, page.language) + _by_axis(visible, page.language)
    found += _of_schema(structured, page.language)
    if not any(statement.trust >= TRUSTED for statement in found):
        scripts = list(embedded_facts(page))
        found += [
            replace(statement, trust=SCRIPT)
            for statement in _labelled(scripts, page.language) + _by_axis(scripts, page.language)
        ]
    return found


def chosen(found: Iterable[Statement]) -> Statement | None:
    """The statement to believe: trusted before untrusted, then the fullest, then the best labelled.

    Statements of equal standing that disagree mark it as contradictory.
    """
    ranked = sorted(found, key=lambda s: (s.trust >= TRUSTED, len(s.size.lengths), s.trust), reverse=True)
    if not ranked:
        return None
    best = ranked[0]
    peers = [
        s.size for s in ranked if s.trust >= min(best.trust, SIZE) and len(s.size.lengths) == len(best.size.lengths)
    ]
    size = agreed([best.size, *peers])
    return best if size is None else replace(best, size=size)


def _labelled(found: Iterable[Fact], language: Language | None) -> list[Statement]:
    statements = []
    for fact in found:
        label = plain(f"{fact.label} {fact.section}")
        own = plain(fact.label)
        if is_package(label) or _is_of_a_part(own) or not (is_dimension_label(label) or _says_size(fact.value)):
            continue
        read = sizes(fact.value, fact.label, language)
        whole = [size for size in read if size.meaning == "whole"]
        size = agreed(_fullest(whole))
        if size is not None and (len(size.lengths) > 1 or size.lengths[0].axis):
            statements.append(Statement(size, _trust(fact, own, label), _shown(fact)))
    return statements


def _fullest(found: Sequence[Size]) -> list[Size]:
    """The sizes of one text that can be statements of one thing: those with the most lengths."""
    most = max((len(size.lengths) for size in found), default=0)
    return [size for size in found if len(size.lengths) == most]


def _trust(fact: Fact, own: str, label: str) -> int:
    if fact.place == "prose" or (fact.place == "line" and not is_dimension_label(own)):
        return PROSE
    if fact.place == "json":
        return SCRIPT
    if is_dimension_label(own):
        # A line of running text that names a size is a seller's description, not the site's table.
        return PROSE if fact.place == "line" else WHOLE if is_whole(own) else SIZE
    return SIZE if is_dimension_label(label) else LOOSE


def _by_axis(found: Iterable[Fact], language: Language | None) -> list[Statement]:
    """Rows that name one axis each (`Width | 4 cm`), gathered by their table."""
    statements = []
    for (_, section), rows in groupby(found, key=lambda fact: (fact.container, fact.section)):
        gathered: dict[str, Length] = {}
        texts = []
        packaged = is_package(plain(section))
        for fact in rows:
            own = plain(fact.label)
            packaged = packaged or is_package(own)
            length = None if _is_of_a_part(own) else _axis_length(fact, language)
            if length is not None and length.axis and length.axis not in gathered:
                gathered[length.axis] = length
                texts.append(_shown(fact))
            place = fact.place
        if gathered and not packaged:
            trust = SCRIPT if place == "json" else PROSE if place == "line" and len(gathered) < 2 else AXES
            statements.append(Statement(Size(tuple(gathered.values()), "whole", ""), trust, "; ".join(texts)))
    return statements


def _axis_length(fact: Fact, language: Language | None) -> Length | None:
    if not fact.label or is_package(plain(fact.label)):
        return None
    read = sizes(fact.value, fact.label, language)
    lengths = [size.lengths for size in read if size.meaning == "whole" and len(size.lengths) == 1]
    return lengths[0][0] if lengths and lengths[0][0].axis else None


def _of_schema(structured: Sequence[tuple[str, str]], language: Language | None) -> list[Statement]:
    lengths: dict[str, Length] = {}
    for axis, text in structured:
        for size in sizes(text, axis, language)[:1]:
            if size.lengths[0].axis:
                lengths.setdefault(size.lengths[0].axis, size.lengths[0])
    text = "; ".join(f"{axis}: {value}" for axis, value in structured)
    return [Statement(Size(tuple(lengths.values()), "whole", "schema.org"), AXES, text)] if lengths else []


def _is_of_a_part(label: str) -> bool:
    return is_component(label) and not (is_whole(label) and not is_component(label.replace("overall", "")))


def _says_size(value: str) -> bool:
    letters = plain(value)
    return is_dimension_label(letters) and is_whole(letters)


def _words(size: Size) -> dict[str, float | None]:
    named = size.dimensions_mm()
    return {axis: named.get(axis) for axis in ("length", "width", "height", "diameter", "depth")} if named else {}


def _flags(best: Statement | None) -> tuple[str, ...]:
    if best is None:
        return ("no_size",)
    low = ("low_trust",) if best.trust == PROSE else ()
    script = ("from_script",) if best.trust == SCRIPT else ()
    return (*low, *script, *best.size.flags)


def _shown(fact: Fact) -> str:
    return squeezed(f"{fact.label}: {fact.value}" if fact.label else fact.value)
