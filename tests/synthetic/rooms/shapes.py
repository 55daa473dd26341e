"""Solids of each category in a unit cube, with x along the length, y along the width, and z up.

Objects whose length is parallel to the wall behind them (a couch) face -y; objects whose length is perpendicular to it
(a bed, a chair) face +x.
"""

from __future__ import annotations

from collections.abc import Callable

from metric_base.arrays import FloatArray
from tests.synthetic.rooms.solids import Mesh, ball, box, join, revolution, stretch_to

__all__ = ["CATEGORIES", "FACES_X", "solid"]

FULL = (0.0, 1.0)


def _legs(top: float, material: str, thick: float = 0.07) -> list[Mesh]:
    ends = ((0.0, thick), (1 - thick, 1.0))
    return [box(x, y, (0, top), material) for x in ends for y in ends]


def _table() -> list[Mesh]:
    return [box(FULL, FULL, (0.93, 1), "wood"), *_legs(0.93, "wood")]


def _desk() -> list[Mesh]:
    drawers = [box((0.72, 0.95), (0.04, 0.9), (low, low + 0.17), "wood_dark") for low in (0.3, 0.49, 0.68)]
    return [box(FULL, FULL, (0.95, 1), "wood"), *_legs(0.95, "metal", 0.05), *drawers]


def _coffee_table() -> list[Mesh]:
    return [
        box(FULL, FULL, (0.88, 1), "wood"),
        *_legs(0.88, "wood"),
        box((0.05, 0.95), (0.05, 0.95), (0.25, 0.3), "wood"),
    ]


def _chair() -> list[Mesh]:
    seat = box((0.08, 1), FULL, (0.47, 0.53), "fabric")
    return [seat, *_legs(0.47, "wood", 0.09), box((0, 0.09), (0, 1), (0.47, 1), "fabric")]


def _office_chair() -> list[Mesh]:
    base = [revolution([(0.5, 0), (0.5, 0.04), (0.12, 0.07)], "dark")]  # circle around the five feet
    column = revolution([(0.05, 0.07), (0.05, 0.4)], "metal")
    arms = [box((0.2, 0.7), y, (0.6, 0.65), "dark") for y in ((0.04, 0.12), (0.88, 0.96))]
    posts = [box((0.4, 0.5), y, (0.46, 0.6), "dark") for y in ((0.04, 0.12), (0.88, 0.96))]
    return [
        *base, column, box((0.1, 0.92), (0.1, 0.9), (0.38, 0.47), "fabric"),
        box((0.05, 0.16), (0.14, 0.86), (0.47, 1), "fabric"), *arms, *posts,
    ]  # fmt: skip


def _stool() -> list[Mesh]:
    return [revolution([(0.5, 0.88), (0.5, 1)], "fabric"), *_legs(0.88, "wood", 0.1)]


def _couch() -> list[Mesh]:
    arms = [box(x, FULL, (0.06, 0.68), "fabric") for x in ((0, 0.1), (0.9, 1))]
    seats = [box(x, (0.02, 0.75), (0.32, 0.5), "fabric") for x in ((0.1, 0.495), (0.505, 0.9))]
    feet = [box(x, y, (0, 0.06), "wood") for x in ((0.02, 0.06), (0.94, 0.98)) for y in ((0.04, 0.12), (0.88, 0.96))]
    return [
        box((0.1, 0.9), (0.02, 0.98), (0.06, 0.32), "fabric"),
        box((0.1, 0.9), (0.72, 1), (0.3, 1), "fabric"),
        *arms,
        *seats,
        *feet,
    ]


def _bed() -> list[Mesh]:
    frame = [
        box((0.03, 1), FULL, (0.12, 0.32), "wood"),
        box((0, 0.03), FULL, (0, 1), "wood"),
        *_legs(0.12, "wood", 0.05),
    ]
    mattress = box((0.03, 0.99), (0.02, 0.98), (0.32, 0.55), "linen")
    pillows = [ball((0.13, y, 0.6), (0.09, 0.19, 0.09), "linen") for y in (0.27, 0.73)]
    return [*frame, mattress, box((0.35, 0.995), (0.01, 0.99), (0.5, 0.58), "fabric"), *pillows]


def _doors() -> list[Mesh]:
    doors = [box(x, (0, 0.04), (0.05, 0.98), "wood") for x in ((0.01, 0.495), (0.505, 0.99))]
    return [box(FULL, (0.04, 1), (0.05, 1), "wood"), box((0.02, 0.98), (0.08, 0.98), (0, 0.05), "wood_dark"), *doors]


def _drawers() -> list[Mesh]:
    fronts = [box((0.02, 0.98), (0, 0.05), (low, low + 0.25), "wood") for low in (0.12, 0.4, 0.68)]
    return [box(FULL, (0.05, 1), (0.08, 1), "wood"), *_legs(0.08, "wood_dark", 0.08), *fronts]


def _tv_stand() -> list[Mesh]:
    doors = [box(x, (0, 0.04), (0.2, 0.9), "wood_dark") for x in ((0.02, 0.32), (0.68, 0.98))]
    return [box(FULL, (0.04, 1), (0.15, 1), "wood"), *_legs(0.15, "metal", 0.05), *doors]


def _bookcase() -> list[Mesh]:
    shelves = [box(FULL, FULL, (z, z + 0.02), "wood") for z in (0.0, 0.245, 0.49, 0.735, 0.98)]
    sides = [box(x, FULL, FULL, "wood") for x in ((0, 0.03), (0.97, 1))]
    books = [
        box(
            (x, x + 0.085),
            (0.1 + 0.1 * ((i + k) % 3), 0.9),
            (z + 0.02, z + 0.15 + 0.02 * ((3 * i + k) % 4)),
            f"book{(i + 2 * k) % 5}",
        )
        for k, z in enumerate((0.0, 0.245, 0.49, 0.735))
        for i, x in enumerate((0.05, 0.14, 0.23, 0.32, 0.45, 0.54, 0.63, 0.8, 0.87))
        if (i + k) % 4
    ]
    return [*shelves, *sides, box(FULL, (0.95, 1), FULL, "wood"), *books]


def _refrigerator() -> list[Mesh]:
    doors = [box((0.01, 0.99), (0, 0.07), z, "white") for z in ((0.03, 0.63), (0.65, 0.99))]
    handles = [box((0.86, 0.9), (-0.03, 0), z, "metal") for z in ((0.4, 0.6), (0.68, 0.85))]
    return [box(FULL, (0.07, 1), FULL, "white"), *doors, *handles]


def _microwave() -> list[Mesh]:
    return [
        box(FULL, (0.05, 1), (0.04, 1), "white"),
        *_legs(0.04, "dark"),
        box((0.03, 0.74), (0, 0.05), (0.1, 0.95), "dark"),
        box((0.78, 0.97), (0.02, 0.05), (0.1, 0.95), "metal"),
    ]


def _washing_machine() -> list[Mesh]:
    ring = revolution([(0.3, 0.0), (0.3, 0.05), (0.2, 0.05), (0.2, 0.04)], "metal", (0.0, 0.0))
    door = Mesh(ring.vertices[:, [0, 2, 1]] * [1, -1, 1] + [0.5, 0.05, 0.45], ring.faces, ring.material)
    return [
        box(FULL, (0.05, 1), (0.02, 1), "white"),
        *_legs(0.02, "dark"),
        door,
        box((0.03, 0.97), (0.02, 0.05), (0.86, 0.97), "metal"),
    ]


def _toilet() -> list[Mesh]:
    bowl = revolution(
        [(0.18, 0), (0.2, 0.2), (0.36, 0.45), (0.37, 0.52), (0.3, 0.52), (0.2, 0.36), (0.0, 0.3)],
        "ceramic",
        (0.63, 0.5),
        1.3,
    )
    foot = box((0.2, 0.6), (0.3, 0.7), (0, 0.4), "ceramic")
    return [
        bowl,
        foot,
        box((0, 0.28), FULL, (0.48, 1), "ceramic"),
        box((0.28, 0.34), (0.15, 0.85), (0.5, 0.95), "ceramic"),
    ]


def _sink() -> list[Mesh]:
    sides = [box(x, FULL, (0.0, 1), "ceramic") for x in ((0, 0.1), (0.9, 1))]
    return [
        *sides,
        box(FULL, (0, 0.1), FULL, "ceramic"),
        box(FULL, (0.85, 1), FULL, "ceramic"),
        box(FULL, FULL, (0, 0.2), "ceramic"),
    ]


def _bathtub() -> list[Mesh]:
    sides = [box(x, FULL, FULL, "ceramic") for x in ((0, 0.06), (0.94, 1))]
    return [
        *sides,
        box(FULL, (0, 0.1), FULL, "ceramic"),
        box(FULL, (0.9, 1), FULL, "ceramic"),
        box(FULL, FULL, (0, 0.15), "ceramic"),
    ]


def _screen() -> list[Mesh]:
    panel = [box(FULL, (0.42, 0.56), (0.12, 1), "dark"), box((0.02, 0.98), (0.4, 0.42), (0.16, 0.97), "picture")]
    return [*panel, box((0.25, 0.75), FULL, (0, 0.025), "dark"), box((0.44, 0.56), (0.52, 0.66), (0.02, 0.4), "dark")]


def _keyboard() -> list[Mesh]:
    rows = [box((0.02, 0.98), (y, y + 0.15), (0.5, 1), "keys") for y in (0.04, 0.23, 0.42, 0.61, 0.8)]
    return [box(FULL, FULL, (0, 0.55), "dark"), *rows]


def _mouse() -> list[Mesh]:
    return [revolution([(0.5, 0), (0.5, 0.3), (0.44, 0.62), (0.3, 0.88), (0.12, 0.98), (0.0, 1)], "dark")]


def _slab(material: str, cover: str) -> Callable[[], list[Mesh]]:
    def parts() -> list[Mesh]:
        return [box(FULL, FULL, (0, 0.85), material), box((0.0, 1), (0.0, 1), (0.85, 1), cover)]

    return parts


def _bottle() -> list[Mesh]:
    label = revolution([(0.5, 0.2), (0.5, 0.5)], "print")
    glass = revolution([(0.47, 0), (0.5, 0.05), (0.5, 0.2)], "glass")
    neck = revolution([(0.5, 0.5), (0.49, 0.6), (0.36, 0.72), (0.17, 0.8), (0.15, 0.93)], "glass")
    return [glass, label, neck, revolution([(0.19, 0.93), (0.19, 1)], "print")]


def _cup() -> list[Mesh]:
    body = revolution([(0.3, 0), (0.4, 0.06), (0.4, 1), (0.37, 1), (0.36, 0.1), (0.0, 0.1)], "print", (0.4, 0.4))
    return [
        body,
        box((0.78, 1), (0.36, 0.44), (0.75, 0.83), "print"),
        box((0.93, 1), (0.36, 0.44), (0.25, 0.8), "print"),
        box((0.78, 1), (0.36, 0.44), (0.2, 0.28), "print"),
    ]


def _bowl() -> list[Mesh]:
    return [revolution([(0.22, 0), (0.26, 0.08), (0.42, 0.5), (0.5, 1), (0.47, 1), (0.36, 0.5), (0.0, 0.15)], "print")]


def _vase() -> list[Mesh]:
    return [
        revolution(
            [(0.3, 0), (0.46, 0.2), (0.5, 0.42), (0.4, 0.65), (0.22, 0.82), (0.28, 1), (0.24, 1), (0.2, 0.8)], "print"
        )
    ]


def _kettle() -> list[Mesh]:
    body = revolution([(0.4, 0), (0.4, 0.1), (0.36, 0.6), (0.25, 0.85), (0.06, 0.9), (0.06, 1)], "metal", (0.4, 0.4))
    return [body, box((0.75, 1), (0.34, 0.46), (0.7, 0.78), "dark"), box((0.92, 1), (0.34, 0.46), (0.2, 0.75), "dark")]


def _toaster() -> list[Mesh]:
    slots = [box((0.12, 0.88), y, (0.97, 1), "dark") for y in ((0.22, 0.36), (0.64, 0.78))]
    return [
        box((0, 0.96), FULL, (0.05, 0.98), "metal"),
        box((0.03, 0.93), (0.04, 0.96), (0, 0.05), "dark"),
        *slots,
        box((0.96, 1), (0.44, 0.56), (0.6, 0.7), "dark"),
    ]


def _lamp() -> list[Mesh]:
    shade = revolution([(0.5, 0.68), (0.34, 1), (0.32, 1), (0.48, 0.68)], "print")
    return [revolution([(0.32, 0), (0.32, 0.03), (0.04, 0.06), (0.03, 0.72)], "metal"), shade]


def _plant() -> list[Mesh]:
    pot = revolution([(0.2, 0), (0.28, 0.3), (0.3, 0.36), (0.26, 0.36), (0.0, 0.33)], "print")
    crown = ((0.5, 0.5, 0.66), (0.5, 0.5, 0.2))
    leaves = (
        ((0.5, 0.5, 0.8), (0.33, 0.33, 0.2)),
        ((0.3, 0.35, 0.56), (0.24, 0.22, 0.14)),
        ((0.7, 0.62, 0.55), (0.24, 0.22, 0.14)),
    )
    more = (crown, ((0.4, 0.72, 0.76), (0.2, 0.2, 0.14)), ((0.62, 0.26, 0.76), (0.2, 0.2, 0.14)))
    return [pot, revolution([(0.03, 0.3), (0.03, 0.7)], "wood_dark"), *(ball(c, r, "leaves") for c, r in leaves + more)]


def _trash_can() -> list[Mesh]:
    return [revolution([(0.4, 0), (0.48, 0.92), (0.5, 0.92), (0.5, 1), (0.46, 1), (0.38, 0.06), (0.0, 0.05)], "print")]


def _suitcase() -> list[Mesh]:
    wheels = [box(x, y, (0, 0.05), "dark") for x in ((0.05, 0.13), (0.87, 0.95)) for y in ((0.1, 0.3), (0.7, 0.9))]
    return [box(FULL, FULL, (0.05, 0.94), "print"), *wheels, box((0.3, 0.7), (0.4, 0.6), (0.94, 1), "dark")]


def _printer() -> list[Mesh]:
    return [
        box(FULL, (0.1, 1), (0, 0.85), "white"),
        box((0.1, 0.9), (0, 0.1), (0.1, 0.25), "dark"),
        box((0.05, 0.95), (0.3, 1), (0.85, 1), "dark"),
        box((0.1, 0.9), (0.09, 0.1), (0.4, 0.6), "dark"),
    ]


def _clock() -> list[Mesh]:
    return [
        box(FULL, FULL, (0, 0.95), "dark"),
        box((0.08, 0.92), (-0.03, 0), (0.15, 0.85), "print"),
        box((0.35, 0.65), (0.3, 0.7), (0.95, 1), "metal"),
    ]


def _teddy_bear() -> list[Mesh]:
    body = [ball((0.5, 0.55, 0.33), (0.32, 0.36, 0.33), "fur"), ball((0.5, 0.5, 0.76), (0.27, 0.32, 0.24), "fur")]
    limbs = [ball((x, 0.25, 0.12), (0.15, 0.25, 0.12), "fur") for x in (0.25, 0.75)]
    arms = [ball((x, 0.45, 0.45), (0.15, 0.2, 0.12), "fur") for x in (0.15, 0.85)]
    return [*body, *limbs, *arms, *(ball((x, 0.55, 0.93), (0.08, 0.06, 0.07), "fur") for x in (0.32, 0.68))]


def _car() -> list[Mesh]:
    wheels = [box(x, y, (0, 0.4), "dark") for x in ((0.12, 0.26), (0.72, 0.86)) for y in ((0, 0.12), (0.88, 1))]
    body = box(FULL, (0.02, 0.98), (0.15, 0.62), "paint")
    cabin = [box((0.26, 0.92), (0.08, 0.92), (0.62, 0.9), "glass"), box((0.3, 0.88), (0.1, 0.9), (0.9, 1), "paint")]
    plates = [box(x, (0.35, 0.65), (0.3, 0.4), "print") for x in ((-0.004, 0), (1, 1.004))]
    return [body, *cabin, *wheels, *plates]


def _truck() -> list[Mesh]:
    wheels = [box(x, y, (0, 0.27), "dark") for x in ((0.08, 0.2), (0.75, 0.87)) for y in ((0, 0.15), (0.85, 1))]
    return [
        box((0.28, 1), FULL, (0.25, 1), "print"),
        box((0, 0.25), (0.03, 0.97), (0.15, 0.75), "paint"),
        box((0.2, 1), (0.2, 0.8), (0.12, 0.25), "dark"),
        *wheels,
    ]


def _person() -> list[Mesh]:
    legs = [box((0.3, 0.7), y, (0, 0.48), "fabric") for y in ((0.25, 0.47), (0.53, 0.75))]
    feet = [box((0.25, 1), y, (0, 0.05), "dark") for y in ((0.25, 0.47), (0.53, 0.75))]
    arms = [box((0.3, 0.7), y, (0.42, 0.82), "print") for y in ((0, 0.18), (0.82, 1))]
    return [
        *legs,
        *feet,
        *arms,
        box((0.0, 0.8), (0.18, 0.82), (0.48, 0.84), "print"),
        ball((0.5, 0.5, 0.925), (0.35, 0.18, 0.075), "skin"),
        box((0.4, 0.6), (0.42, 0.58), (0.84, 0.88), "skin"),
    ]


def _stop_sign() -> list[Mesh]:
    ring = revolution([(0.5, 0.0), (0.5, 1.0)], "sign", (0.0, 0.0))
    plate = Mesh(ring.vertices[:, [0, 2, 1]] * [1, 0.4, 0.34] + [0.5, 0, 0.83], ring.faces, ring.material)
    return [plate, box((0.45, 0.55), (0.4, 1), (0, 0.95), "metal")]


def _bench() -> list[Mesh]:
    slats = [box(FULL, (y, y + 0.15), (0.48, 0.53), "wood") for y in (0.0, 0.2, 0.4, 0.6)]
    sides = [box(x, (0, 0.9), (0, 0.48), "metal") for x in ((0.05, 0.1), (0.9, 0.95))]
    return [
        *slats,
        *sides,
        *(box(FULL, (0.9, 1), (z, z + 0.15), "wood") for z in (0.6, 0.85)),
        box((0.05, 0.1), (0.85, 0.95), (0.4, 1), "metal"),
    ]


def _bus() -> list[Mesh]:
    wheels = [box(x, y, (0, 0.3), "dark") for x in ((0.15, 0.24), (0.7, 0.79)) for y in ((0, 0.1), (0.9, 1))]
    return [
        box(FULL, FULL, (0.12, 1), "paint"),
        *wheels,
        *(box((0.05, 0.95), y, (0.5, 0.85), "glass") for y in ((-0.004, 0), (1, 1.004))),
    ]


#: Functions that return the parts of each category.
CATEGORIES: dict[str, Callable[[], list[Mesh]]] = {
    "alarm clock": _clock, "armchair": _couch, "bathtub": _bathtub, "bed": _bed, "bench": _bench,
    "book": _slab("paper", "print"), "bookcase": _bookcase, "bottle": _bottle, "bowl": _bowl, "bus": _bus,
    "cabinet": _doors, "car": _car, "cell phone": _slab("dark", "picture"), "chair": _chair, "coffee table":
    _coffee_table, "couch": _couch, "cup": _cup, "desk": _desk, "dining table": _table, "dresser": _drawers,
    "floor lamp": _lamp, "kettle": _kettle, "keyboard": _keyboard, "lamp": _lamp, "laptop": _slab("metal", "print"),
    "microwave": _microwave, "monitor": _screen, "mouse": _mouse, "nightstand": _drawers, "office chair":
    _office_chair, "person": _person, "potted plant": _plant, "printer": _printer, "refrigerator": _refrigerator,
    "remote": _slab("dark", "keys"), "sink": _sink, "stool": _stool, "stop sign": _stop_sign, "suitcase": _suitcase,
    "teddy bear": _teddy_bear, "toaster": _toaster, "toilet": _toilet, "trash can": _trash_can, "truck": _truck, "tv":
    _screen, "tv stand": _tv_stand, "vase": _vase, "wardrobe": _doors, "washing machine": _washing_machine,
}  # fmt: skip

#: Categories whose length is perpendicular to the wall behind them.
FACES_X = frozenset({"bed", "chair", "office chair", "toilet", "person", "car", "truck", "bus"})


def solid(category: str, size: FloatArray) -> Mesh:
    """Return a category's solid with a bounding box of exactly `size` (length, width, height) in metres, on z = 0."""
    return stretch_to(join(CATEGORIES[category]()), size)
