"""Choose the sense of a name in a source, by the domain of the source."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Literal

import msgspec

from metric_base.folders import taxonomy_directory
from metric_base.records import toml_record
from taxonomy.categories import PREFIX
from taxonomy.words.senses import Sense, reviewed_meanings

#: Reason for a sense: the only possible one, preferred by the domain, named by the category path, first in a reviewed
#: order, the most frequent of several, the only possible one but not the most frequent.
Certainty = Literal["sole", "domain", "path", "usual", "frequent", "rare"]


class Domain(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Domain of a source."""

    requires: tuple[str, ...]  #: Concepts; all matches are below one of them.
    prefers: tuple[str, ...] = ()  #: Concepts; senses below one of them come first.
    narrow: bool = False  #: If a name has a sense in the domain (ships, trees), it is the meaning.


class DomainTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The domains of `data/taxonomy/domains.toml`."""

    too_general: frozenset[str]  #: Concepts so general that their items have no typical size.
    groups: dict[str, tuple[str, ...]]  #: Concepts by a name that stands for them in `requires`.
    domains: dict[str, Domain]

    def __post_init__(self) -> None:
        for name, domain in self.domains.items():
            requires = (concept for one in domain.requires for concept in self.groups.get(one, (one,)))
            self.domains[name] = msgspec.structs.replace(domain, requires=tuple(requires))


_TABLE = toml_record(taxonomy_directory() / "domains.toml", DomainTable)
DOMAINS = _TABLE.domains


def chosen_sense(
    senses: Sequence[Sense], domain: Domain, word: str = "", near: Collection[str] = ()
) -> tuple[Sense, Certainty] | None:
    """Return the sense of a word in a domain, and the reason; None if no sense is an object of the domain.

    Insertions come first, because a reviewer added them for the word. The other rules, in order: the only possible
    sense, the only preferred one, one that the rest of the category path names, the first of an unambiguous reviewed
    order, and the order of WordNet, which is by frequency.

    Parameters
    ----------
    senses : sequence of Sense
        Senses of the word in the order of WordNet.
    domain : Domain
    word : str
        The word, to look up its reviewed order.
    near : collection of str
        Concepts that the rest of the category path names.
    """
    possible = [sense for sense in senses if fits(sense, domain)]
    if not possible:
        return None
    if possible[0].concept.startswith(PREFIX) or (len(possible) == 1 and possible[0] == senses[0]):
        return possible[0], "sole"
    preferred = [sense for sense in possible if sense.is_a(domain.prefers)]
    among = preferred or possible
    if len(preferred) == 1 or domain.narrow:
        return among[0], "domain"
    named = [sense for sense in possible if sense.concept in near]
    if named:
        return named[0], "path"
    order = reviewed_meanings(word)
    usual = [sense for sense in possible if order and order.clear and sense.concept == order.nodes[0]]
    if usual:
        return usual[0], "usual"
    return among[0], "rare" if len(possible) == 1 else "frequent"


def fits(sense: Sense, domain: Domain) -> bool:
    """Return True if a sense belongs to a domain and is specific enough to have a typical size."""
    if sense.concept.startswith(PREFIX) and not domain.narrow:
        return True  # a reviewer added it as an item with a size
    return sense.concept not in _TABLE.too_general and sense.is_a(domain.requires)
