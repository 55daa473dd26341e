"""Which categories stand on the floor, which hang, and which end at a level top: where the name alone settles it.

The tree's hypernyms do not say this, so that the lists are here: a mirror and a wardrobe are both furniture, a wall
clock and a washing machine both devices. The answer decides how far an object whose foot is not reconstructed may
reach down. A caller that knows more, such as
the tree's hypernyms, passes its own function to `measure_objects`.
"""

from __future__ import annotations

# Objects whose foot is on the floor or the road whenever they are in use; "cabinet", "lamp" and "plant" may be either.
_FLOOR = frozenset(
    """
    armchair bathtub bed bench bicycle bike bookcase bookshelf bus car chair couch crib cupboard cyclist desk dishwasher
    door dresser fireplug freezer fridge futon hydrant loveseat motorbike motorcycle nightstand ottoman pedestrian
    person pram refrigerator scooter settee sideboard sofa stool stroller suv table toilet tram truck van wardrobe
    washer
    """.split()  # noqa: SIM905  a list of words reads better than a list of strings
)
# Objects on walls, ceilings, poles or in the air.
_HUNG = frozenset(
    """
    airplane balloon banner bird blind chandelier clock curtain drone flag hood kite mirror painting photograph picture
    poster radiator sconce shower sink tapestry towel washbasin whiteboard window
    """.split()  # noqa: SIM905
)
# What ends at a level top on which other objects lie. Beds have headboards, benches backs; cabinets may hang.
_LEVEL = frozenset(["counter", "desk", "nightstand", "ottoman", "sideboard", "stand", "stool", "table"])
_PHRASES = {
    "ceiling lamp": False,
    "pendant lamp": False,
    "wall lamp": False,
    "wall cabinet": False,
    "traffic light": False,
    "air conditioner": False,
    "picture frame": False,
    "floor lamp": True,
    "washing machine": True,
    "dining table": True,
    "chest of drawers": True,
    "filing cabinet": True,
    "parking meter": True,
    "fire hydrant": True,
    "teddy bear": None,
    "table lamp": None,
    "toy car": None,
    "car seat": None,
}


def stands_on_floor(category: str) -> bool | None:
    """True where the category stands on the floor, False where it hangs, None where the name does not settle it."""
    words = category.lower().replace("_", " ").replace("-", " ").split()
    for phrase in (" ".join(words), " ".join(words[-2:])):
        if phrase in _PHRASES:
            return _PHRASES[phrase]
    last = words[-1] if words else ""
    return True if last in _FLOOR else False if last in _HUNG else None


def has_level_top(category: str) -> bool:
    """Whether the category's own height is that of a level top."""
    words = category.lower().replace("_", " ").replace("-", " ").split()
    return bool(words) and words[-1] in _LEVEL
