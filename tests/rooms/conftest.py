from __future__ import annotations

import pytest

from benchmarks.rooms.furnish import furnished_room
from benchmarks.rooms.quick import MadeScene, quick_scene
from benchmarks.rooms.render import NoOpenGL
from benchmarks.rooms.world import World


@pytest.fixture(scope="session")
def room() -> World:
    return furnished_room("study", 1003)


@pytest.fixture(scope="session")
def made(room: World) -> MadeScene:
    try:
        return quick_scene(room, seed=1003)
    except NoOpenGL as missing:
        pytest.skip(str(missing))
