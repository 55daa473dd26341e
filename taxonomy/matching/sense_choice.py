"""Choose the sense of a name in a source, by the domain of the source."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from taxonomy.categories import PREFIX
from taxonomy.words.senses import Sense, reviewed_meanings

#: Reason for a sense: the only possible one, preferred by the domain, named by the category path, first in a reviewed
#: order, the most frequent of several, the only possible one but not the most frequent.
Certainty = Literal["sole", "domain", "path", "usual", "frequent", "rare"]


@dataclass(frozen=True, slots=True)
class Domain:
    """Domain of a source."""

    requires: tuple[str, ...]  #: Concepts; all matches are below one of them.
    prefers: tuple[str, ...] = ()  #: Concepts; senses below one of them come first.
    narrow: bool = False  #: If a name has a sense in the domain (ships, trees), it is the meaning.


#: Artifacts that WordNet treats as abstractions.
_ABSTRACT = ("coin.n.01", "decoration.n.02", "badge.n.01", "crosier.n.01", "bill.n.03", "manuscript.n.02",
    "street_sign.n.01", "traffic_light.n.01", "pack_of_cards.n.01", "bar_soap.n.01", "party_favor.n.01",
)  # fmt: skip
_ARTIFACTS = ("artifact.n.01", "playing_card.n.01", "amulet.n.01", *_ABSTRACT)
_OBJECTS = (
    *_ARTIFACTS, "animal.n.01", "plant.n.02", "fungus.n.01", "food.n.01", "food.n.02", "fruit.n.01",
    "natural_object.n.01",
)  # fmt: skip

#: Concepts so general that their items have no typical size.
_TOO_GENERAL = frozenset(
    {"artifact.n.01", "instrumentality.n.03", "article.n.02", "creation.n.02", "commodity.n.01", "device.n.01",
     "product.n.02", "structure.n.01", "part.n.02", "component.n.03", "animal.n.01", "plant.n.02", "unit.n.05",
     "food.n.01", "food.n.02", "natural_object.n.01", "thing.n.04", "equipment.n.01", "facility.n.01",
     "decoration.n.01", "covering.n.02", "work.n.02", "end.n.09", "top.n.09", "piece.n.01", "design.n.02",
     "accessory.n.01", "holder.n.01", "figure.n.04", "burner.n.01", "container.n.01", "implement.n.01", "tool.n.01",
     "vessel.n.02", "craft.n.02", "vehicle.n.01", "replica.n.01", "copy.n.01", "tree.n.01", "dog.n.01", "ornament.n.01",
     "fabric.n.01", "material.n.01", "way.n.06", "surface.n.01", "excavation.n.03", "substance.n.01",
     "collection.n.01", "system.n.01", "assembly.n.05", "base.n.08", "fixture.n.01"}
)  # fmt: skip

#: Domains, broad ones first; `data/taxonomy/readings.toml` assigns them to sources.
DOMAINS = {
    "objects": Domain(_OBJECTS, ("instrumentality.n.03", "artifact.n.01")),
    "household": Domain(
        _OBJECTS,
        ("furniture.n.01", "home_appliance.n.01", "kitchen_utensil.n.01", "tableware.n.01", "bedclothes.n.01",
         "container.n.01", "plumbing_fixture.n.01", "lamp.n.02", "electronic_equipment.n.01", "device.n.01",
         "instrumentality.n.03", "artifact.n.01"),
    ),
    "furniture": Domain(
        _ARTIFACTS, ("furniture.n.01", "bedclothes.n.01", "container.n.01", "furnishing.n.02", "instrumentality.n.03")
    ),
    "museum": Domain(
        _ARTIFACTS,
        ("vessel.n.03", "container.n.01", "tableware.n.01", "jewelry.n.01", "adornment.n.01", "weapon.n.01",
         "plastic_art.n.01", "graphic_art.n.01", "art.n.01", "furniture.n.01", "utensil.n.01", "tool.n.01",
         "implement.n.01", "device.n.01", "instrumentality.n.03", "covering.n.02"),
    ),
    "electronics": Domain(("artifact.n.01",), ("electronic_equipment.n.01", "electronic_device.n.01", "device.n.01")),
    "shop": Domain(
        _OBJECTS,
        ("plaything.n.01", "game_equipment.n.01", "sports_equipment.n.01", "clothing.n.01", "container.n.01",
         "furniture.n.01", "vehicle.n.01", "device.n.01", "instrumentality.n.03", "artifact.n.01"),
    ),
    "ship": Domain(("vessel.n.02", "craft.n.02"), ("ship.n.01",), narrow=True),
    "vehicle": Domain(("conveyance.n.03", "vehicle.n.01", "person.n.01", "container.n.01", "chair.n.01"), narrow=True),
    "car": Domain(("motor_vehicle.n.01",), ("car.n.01",), narrow=True),
    "aircraft": Domain(("aircraft.n.01",), ("airplane.n.01",), narrow=True),
    "tree": Domain(("vascular_plant.n.01",), ("tree.n.01", "woody_plant.n.01"), narrow=True),
    "dog": Domain(("dog.n.01",), narrow=True),
    "fish": Domain(("fish.n.01",), narrow=True),
    "animal": Domain(("animal.n.01",), narrow=True),
    "person": Domain(("person.n.01",), narrow=True),
    "fastener": Domain(("artifact.n.01",), ("fastener.n.02", "restraint.n.06", "holding_device.n.01")),
}  # fmt: skip


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
    return sense.concept not in _TOO_GENERAL and sense.is_a(domain.requires)
