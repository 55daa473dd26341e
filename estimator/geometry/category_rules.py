"""Categories that stand on the floor, that hang, and that end at a level top, if the name determines it.

The lists are here because hypernyms do not contain this: a mirror and a wardrobe are furniture, a wall clock and a
washing machine are devices. They determine whether an object whose foot is not reconstructed is extended downwards. A
caller with better information passes its own function (`MeasurementOptions.standing`).
"""

from __future__ import annotations

# Objects whose foot is on the floor or the road when they are used. "cabinet", "lamp" and "plant" may also hang.
_FLOOR = frozenset(
    """
    armchair bathtub bed bench bicycle bike bookcase bookshelf bus car chair couch crib cupboard cyclist desk dishwasher
    door dresser fireplug freezer fridge futon hydrant loveseat motorbike motorcycle nightstand ottoman pedestrian
    person pram refrigerator scooter settee sideboard sofa stool stroller suv table toilet tram truck van wardrobe
    washer
    """.split()  # noqa: SIM905  words are more legible than a list of strings
)
# Objects on walls, ceilings, poles or in the air.
_HUNG = frozenset(
    """
    airplane balloon banner bird blind chandelier clock curtain drone flag hood kite mirror painting photograph picture
    poster radiator sconce shower sink tapestry towel washbasin whiteboard window
    """.split()  # noqa: SIM905
)
# Objects that end at a level top with other objects on it. Beds have headboards, benches have backs.
_LEVEL = frozenset(["counter", "desk", "nightstand", "ottoman", "sideboard", "stand", "stool", "table"])
# The same, but many are so tall, or hang so high, that no view shows their top and nothing is on it.
_OFTEN_LEVEL = frozenset(["cabinet", "cupboard", "dishwasher", "drawers", "dresser", "machine", "washer"])
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
    """Return True if a category stands on the floor, False if it hangs, and None if its name does not determine it."""
    words = category.lower().replace("_", " ").replace("-", " ").split()
    for phrase in (" ".join(words), " ".join(words[-2:])):
        if phrase in _PHRASES:
            return _PHRASES[phrase]
    last = words[-1] if words else ""
    return True if last in _FLOOR else False if last in _HUNG else None


def has_level_top(category: str) -> bool | None:
    """Return whether the height of a category ends at a level top; None if it does where this top is visible."""
    words = category.lower().replace("_", " ").replace("-", " ").split()
    last = words[-1] if words else ""
    return True if last in _LEVEL else None if last in _OFTEN_LEVEL else False
