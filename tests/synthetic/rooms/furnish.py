"""Furnish five kinds of rooms: large objects at walls, chairs at tables, small objects on top of others."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from metric_base.arrays import FloatArray
from tests.synthetic.rooms.cameras import walk
from tests.synthetic.rooms.kinds import KINDS, RoomKind
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.layout import Footprint, apart, distance_to, inside
from tests.synthetic.rooms.shapes import CATEGORIES, FACES_X, solid
from tests.synthetic.rooms.sizes import Sizes, typical_sizes
from tests.synthetic.rooms.solids import Mesh, box, join, rotate
from tests.synthetic.rooms.world import Placed, World

__all__ = ["furnished_room", "tilted_solid", "turn_about_z"]

#: Maximum number of random positions for an object; if none is free, the object is omitted.
MAX_TRIES = 120
#: Minimum distance of objects from the camera's path in metres: half the width of a person and the arm.
CAMERA_CLEARANCE_M = 0.4
#: Height of the ceiling in metres.
CEILING_M = 2.6


@dataclass(slots=True)
class _Layout:
    """Objects that are already placed, with their footprints."""

    kind: RoomKind
    eyes: FloatArray  # (v, 2) camera centres on the ground
    placed: list[Placed] = field(default_factory=list)
    prints: dict[str, Footprint] = field(default_factory=dict)


def turn_about_z(yaw: float) -> FloatArray:
    """Return the rotation (3, 3) about the vertical axis."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def tilted_solid(category: str, size: FloatArray, tilt_rad: float, axis_yaw: float) -> Mesh:
    """Return a category's solid of exactly `size`, tilted about a horizontal axis, with its base at z = 0."""
    mesh = solid(category, size)
    if tilt_rad == 0:
        return mesh
    c, s = np.cos(tilt_rad), np.sin(tilt_rad)
    rotation = turn_about_z(axis_yaw) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ turn_about_z(-axis_yaw)
    tilted = rotate(mesh, rotation, np.zeros(3))
    low, high = tilted.vertices.min(axis=0), tilted.vertices.max(axis=0)
    return rotate(tilted, np.eye(3), -np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]))


def furnished_room(kind: str, seed: int, knobs: Knobs | None = None, sizes: Sizes = typical_sizes) -> World:
    """Return a room of a kind (a key of `KINDS`). The result depends only on seed, knobs and sizes."""
    knobs = knobs or Knobs()
    rules = KINDS[kind]
    generator = np.random.default_rng([seed, sorted(KINDS).index(kind)])
    poses = walk(rules.radius, (0.0, 0.2), knobs, generator)
    layout = _Layout(rules, np.array([pose.centre[:2] for pose in poses]))
    for category, low, high, rule in rules.furniture:
        for _ in range(int(generator.integers(low, high + 1))):
            _place(layout, category, rule, knobs, sizes, generator)
    kept = _keep_some(layout.placed, knobs.objects, generator)
    objects = tuple(_mislabel(item, knobs, generator) for item in kept)
    return World(kind, seed, objects, _shell(rules.floor, generator), poses)


def _place(
    layout: _Layout, category: str, rule: str, knobs: Knobs, sizes: Sizes, generator: np.random.Generator
) -> None:
    """Add an object at a random free position that satisfies the placement rule, if there is one."""
    size = sizes(category, generator) / 1000.0
    tilt = np.radians(knobs.tilt_deg) if generator.random() < knobs.tilted else 0.0
    mesh = tilted_solid(category, size, tilt, generator.uniform(0, 2 * np.pi))
    half = (mesh.vertices[:, :2].max(axis=0) - mesh.vertices[:, :2].min(axis=0)) / 2
    for _ in range(MAX_TRIES):
        candidate = _candidate(layout, category, rule, half, generator)
        if candidate is None:
            return
        print_, support = candidate
        if _fits(layout, print_, support, float(mesh.vertices[:, 2].max())):
            track = f"{category.replace(' ', '_')}-{1 + sum(other.category == category for other in layout.placed)}"
            base = (
                0.0
                if support is None
                else next(t for t in layout.placed if t.track == support).mesh.vertices[:, 2].max()
            )
            world = rotate(mesh, turn_about_z(print_.yaw), np.array([*print_.centre, base]))
            layout.placed.append(
                Placed(track, category, category, size, world, tilt_deg=float(np.degrees(tilt)), support=support)
            )
            layout.prints[track] = print_
            return


def _candidate(
    layout: _Layout, category: str, rule: str, half: FloatArray, generator: np.random.Generator
) -> tuple[Footprint, str | None] | None:
    """Return a random footprint for a placement rule, and the supporting object; None if there is no such object."""
    relation, _, names = rule.partition(" ")
    if relation in ("on", "at"):
        hosts = [t.track for t in layout.placed if t.category in names.split("|") and t.tilt_deg == 0]
        if not hosts:
            return None
        host = hosts[int(generator.integers(len(hosts)))]
        return (
            (_on(layout.prints[host], half, generator), host)
            if relation == "on"
            else (_at(layout.prints[host], half, generator), None)
        )
    room = np.array(layout.kind.floor) / 2
    if relation == "wall":
        return _against_wall(room, half, category in FACES_X, generator), None
    if relation == "centre":
        return Footprint(generator.uniform([-0.5, 0.0], [0.5, 0.7]), half, float(generator.normal(0, 0.2))), None
    return Footprint(generator.uniform(-room, room), half, float(generator.uniform(-np.pi, np.pi))), None


def _against_wall(room: FloatArray, half: FloatArray, faces_x: bool, generator: np.random.Generator) -> Footprint:
    """Return a footprint a few centimetres from the far (probability 0.5), left or right wall, with its back to it."""
    wall = int(generator.choice(3, p=[0.5, 0.25, 0.25]))
    yaw = (0.0, np.pi / 2, -np.pi / 2)[wall] - (np.pi / 2 if faces_x else 0.0)
    along, depth = (half[1], half[0]) if faces_x else (half[0], half[1])
    off = depth + generator.uniform(0.02, 0.06)
    if wall == 0:
        centre = np.array([generator.uniform(-room[0] + along, room[0] - along), room[1] - off])
    else:
        centre = np.array(
            [(room[0] - off) * (-1 if wall == 1 else 1), generator.uniform(-0.4, max(-0.39, room[1] - along))]
        )
    return Footprint(centre, half, float(yaw))


def _on(host: Footprint, half: FloatArray, generator: np.random.Generator) -> Footprint:
    """Return a footprint on top of a host, approximately aligned with it."""
    margin = np.maximum(host.half - half.max() * 0.9, 0.0)
    centre = host.centre + generator.uniform(-margin, margin) @ host.axes
    quarter = np.pi / 2 * int(generator.integers(4)) if half.max() < 0.15 else 0.0
    return Footprint(centre, half, float(host.yaw + quarter + generator.normal(0, 0.15)))


def _at(host: Footprint, half: FloatArray, generator: np.random.Generator) -> Footprint:
    """Return a footprint at one side of a table, facing it."""
    side, sign = int(generator.integers(2)), float(generator.choice([-1.0, 1.0]))
    out = sign * host.axes[side]
    slide = generator.uniform(-0.6, 0.6) * max(host.half[1 - side] - half[1], 0.0) * host.axes[1 - side]
    centre = host.centre + slide + out * (host.half[side] + half[0] + generator.uniform(0.06, 0.2))
    return Footprint(centre, half, float(np.arctan2(-out[1], -out[0]) + generator.normal(0, 0.12)))


def _fits(layout: _Layout, print_: Footprint, support: str | None, height: float) -> bool:
    neighbours = [layout.prints[item.track] for item in layout.placed if item.support == support]
    if not all(apart(print_, other, 0.01) for other in neighbours):
        return False
    if support is not None:
        return inside(print_, layout.prints[support])
    floor = Footprint(np.zeros(2), np.array(layout.kind.floor) / 2, 0.0)
    if not inside(print_, floor) or height > CEILING_M - 0.05:
        return False
    return bool(distance_to(print_, layout.eyes).min() > CAMERA_CLEARANCE_M)


def _keep_some(placed: list[Placed], keep: int | None, generator: np.random.Generator) -> list[Placed]:
    """Remove random objects that support no other object until `keep` objects remain."""
    remaining = list(placed)
    while keep is not None and len(remaining) > max(keep, 1):
        supports = {item.support for item in remaining}
        removable = [k for k, item in enumerate(remaining) if item.track not in supports]
        remaining.pop(removable[int(generator.integers(len(removable)))])
    return remaining


def _mislabel(item: Placed, knobs: Knobs, generator: np.random.Generator) -> Placed:
    """Return the object with a wrong label, or without points on its foot, with the probabilities of the knobs."""
    wrong, footless = generator.random(2) < (knobs.mislabelled, knobs.missing_feet)
    others = sorted(set(CATEGORIES) - {item.category})
    other = others[int(generator.integers(len(others)))]
    return replace(item, label=other if wrong else item.label, no_foot=bool(footless))


def _shell(floor: tuple[float, float], generator: np.random.Generator) -> Mesh:
    """Return the surfaces without label: floor, walls, ceiling, a rug, a door and images on the walls."""
    x, y = floor[0] / 2, floor[1] / 2
    walls = [
        box((-x, x), (-y, y), (-0.02, 0), "floor"), box((-x, x), (-y, y), (CEILING_M, CEILING_M + 0.02), "ceiling"),
        box((-x, x), (y, y + 0.02), (0, CEILING_M), "wall"), box((-x, x), (-y - 0.02, -y), (0, CEILING_M), "wall"),
        box((-x - 0.02, -x), (-y, y), (0, CEILING_M), "wall"), box((x, x + 0.02), (-y, y), (0, CEILING_M), "wall"),
        box((-0.75 * x, 0.75 * x), (-0.55 * y, 0.5 * y), (0, 0.004), "rug"),
    ]  # fmt: skip
    pictures = []
    for k in range(5):
        width, low = generator.uniform(0.3, 0.8), generator.uniform(1.2, 1.6)
        offset = generator.uniform(-0.85, 0.6)
        span, tall = (offset, offset + width), (low, low + generator.uniform(0.3, 0.7))
        if k < 3:
            start = x * (2 * k - 2) / 2.6 + offset / 3
            pictures.append(box((start, start + width), (y - 0.012, y), tall, "picture"))
        else:
            side = (-x, -x + 0.012) if k == 3 else (x - 0.012, x)
            pictures.append(box(side, span, tall, "picture"))
    return join([*walls, *pictures, box((-x, -x + 0.015), (-0.8 * y, -0.8 * y + 0.9), (0, 2.05), "wood")])
