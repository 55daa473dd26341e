"""Which sense of a name a source means: by what its domain holds and what can have a size at all."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from taxonomy.categories import PREFIX
from taxonomy.words.senses import Sense, reviewed_meanings

#: Why a sense was chosen: no other is possible; the domain prefers it; the category path names it too; it is
#: the usual one in a reviewed order; it is the most frequent of several; it is the only one possible, yet not frequent.
Certainty = Literal["sole", "domain", "path", "usual", "frequent", "rare"]


@dataclass(frozen=True, slots=True)
class Domain:
    """What a source speaks of: every match lies below one of `requires`, senses below any of `prefers` come first.

    In a `narrow` domain (ships, trees) a name that has a sense there means it, whatever else it means elsewhere.
    """

    requires: tuple[str, ...]
    prefers: tuple[str, ...] = ()
    narrow: bool = False


#: Items with a size: what is made, what lives, what is eaten; the last few are abstractions to WordNet.
_ABSTRACT = ("coin.n.01", "decoration.n.02", "badge.n.01", "crosier.n.01", "bill.n.03", "manuscript.n.02",
    "street_sign.n.01", "traffic_light.n.01", "pack_of_cards.n.01", "bar_soap.n.01", "party_favor.n.01",
)  # fmt: skip
_ARTIFACTS = ("artifact.n.01", "playing_card.n.01", "amulet.n.01", *_ABSTRACT)
_OBJECTS = (
    *_ARTIFACTS, "animal.n.01", "plant.n.02", "fungus.n.01", "food.n.01", "food.n.02", "fruit.n.01",
    "natural_object.n.01",
)  # fmt: skip

#: Words for anything at all: a match to one of them says nothing.
_SAYS_NOTHING = frozenset(
    {"artifact.n.01", "instrumentality.n.03", "article.n.02", "creation.n.02", "commodity.n.01", "device.n.01",
     "product.n.02", "structure.n.01", "part.n.02", "component.n.03", "animal.n.01", "plant.n.02", "unit.n.05",
     "food.n.01", "food.n.02", "natural_object.n.01", "thing.n.04", "equipment.n.01", "facility.n.01",
     "decoration.n.01", "covering.n.02", "work.n.02", "end.n.09", "top.n.09", "piece.n.01", "design.n.02",
     "accessory.n.01", "holder.n.01", "figure.n.04", "burner.n.01", "container.n.01", "implement.n.01", "tool.n.01",
     "vessel.n.02", "craft.n.02", "vehicle.n.01", "replica.n.01", "copy.n.01", "tree.n.01", "dog.n.01", "ornament.n.01",
     "fabric.n.01", "material.n.01", "way.n.06", "surface.n.01", "excavation.n.03", "substance.n.01",
     "collection.n.01", "system.n.01", "assembly.n.05", "base.n.08", "fixture.n.01"}
)  # fmt: skip

#: The domains of the sources, broad ones first; `data/taxonomy/readings.toml` says which source has which.
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
    """The sense that the domain means, of those a word may have, and why; None where no sense is an object of it.

    Insertions come first: a reviewer has put them there for the word. Then, where only one sense is possible or the
    domain prefers one, that one; the one that the rest of the category path names; the first of a
    clear reviewed order; WordNet's own order, which is by frequency in its texts.

    Parameters
    ----------
    senses : in WordNet's order; word : what they are senses of
    near : concepts that the rest of the category path names
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
    """Return True if the domain holds a sense and it says enough to have a size."""
    if sense.concept.startswith(PREFIX) and not domain.narrow:
        return True  # a reviewer has put it in as an item with a size, wherever WordNet would have it
    return sense.concept not in _SAYS_NOTHING and sense.is_a(domain.requires)
