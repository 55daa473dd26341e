"""Which sense of a name a source means: by what its domain holds and what can have a size at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from taxonomy.insertions import PREFIX
from taxonomy.matching.lexicon import Lexicon

__all__ = ["DOMAINS", "Domain", "Sense", "fits", "sense"]


@dataclass(frozen=True, slots=True)
class Domain:
    """What a source speaks of: every match lies below one of `requires`, senses below any of `prefers` come first.

    In a `narrow` domain (ships, trees) a name that has a sense there means it, whatever else it means elsewhere.
    """

    requires: tuple[str, ...]
    prefers: tuple[str, ...] = ()
    narrow: bool = False


@dataclass(frozen=True, slots=True)
class Sense:
    """The concept chosen and why: `sole` (no other sense is possible), `domain`, `frequent`, or `rare`."""

    concept: str
    certainty: str


#: Things with a size: what is made, what lives, what is eaten; the last few are abstractions to WordNet.
_ABSTRACT = ("coin.n.01", "decoration.n.02", "badge.n.01", "crosier.n.01", "bill.n.03", "manuscript.n.02",
    "street_sign.n.01", "traffic_light.n.01", "pack_of_cards.n.01", "bar_soap.n.01", "party_favor.n.01",
)  # fmt: skip
_MADE = ("artifact.n.01", "playing_card.n.01", "amulet.n.01", *_ABSTRACT)
_THINGS = (
    *_MADE, "animal.n.01", "plant.n.02", "fungus.n.01", "food.n.01", "food.n.02", "fruit.n.01", "natural_object.n.01",
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
    "things": Domain(_THINGS, ("instrumentality.n.03", "artifact.n.01")),
    "household": Domain(
        _THINGS,
        ("furniture.n.01", "home_appliance.n.01", "kitchen_utensil.n.01", "tableware.n.01", "bedclothes.n.01",
         "container.n.01", "plumbing_fixture.n.01", "lamp.n.02", "electronic_equipment.n.01", "device.n.01",
         "instrumentality.n.03", "artifact.n.01"),
    ),
    "furniture": Domain(
        _MADE, ("furniture.n.01", "bedclothes.n.01", "container.n.01", "furnishing.n.02", "instrumentality.n.03")
    ),
    "museum": Domain(
        _MADE,
        ("vessel.n.03", "container.n.01", "tableware.n.01", "jewelry.n.01", "adornment.n.01", "weapon.n.01",
         "plastic_art.n.01", "graphic_art.n.01", "art.n.01", "furniture.n.01", "utensil.n.01", "tool.n.01",
         "implement.n.01", "device.n.01", "instrumentality.n.03", "covering.n.02"),
    ),
    "electronics": Domain(("artifact.n.01",), ("electronic_equipment.n.01", "electronic_device.n.01", "device.n.01")),
    "shop": Domain(
        _THINGS,
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


def sense(concepts: Sequence[str], domain: Domain, lexicon: Lexicon) -> Sense | None:
    """The concept that the domain means, of those a name may have; None where none is a thing of the domain.

    Insertions come before WordNet's senses: a reviewer has put them there for the name. Among the others those that
    the domain prefers come first, then WordNet's own order, which is by frequency in its texts.
    """
    possible = [concept for concept in concepts if fits(concept, domain, lexicon)]
    if not possible:
        return None
    if possible[0].startswith(PREFIX):
        return Sense(possible[0], "sole")
    if len(possible) == 1 and possible[0] == concepts[0]:
        return Sense(possible[0], "sole")
    preferred = [concept for concept in possible if lexicon.is_a(concept, domain.prefers)]
    if len(preferred) == 1 or (domain.narrow and not preferred):
        return Sense((preferred or possible)[0], "domain")
    best = (preferred or possible)[0]
    if domain.narrow:
        return Sense(best, "domain")
    return Sense(best, "rare" if len(possible) == 1 else "frequent")


def fits(concept: str, domain: Domain, lexicon: Lexicon) -> bool:
    """Whether the domain holds the concept and it says enough to have a size."""
    if concept.startswith(PREFIX) and not domain.narrow:
        return True  # a reviewer has put it in as a thing with a size, wherever WordNet would have it
    return concept not in _SAYS_NOTHING and lexicon.is_a(concept, domain.requires)
