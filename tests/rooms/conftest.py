from __future__ import annotations

import pytest

from tests.made.rooms.furnish import furnished_room
from tests.made.rooms.quick import MadeScene, quick_scene
from tests.made.rooms.render import NoOpenGL
from tests.made.rooms.world import World


@pytest.fixture(scope="session")
def room() -> World:
    return furnished_room("study", 1003)


@pytest.fixture(scope="session")
def made(room: World) -> MadeScene:
    try:
        return quick_scene(room, seed=1003)
    except NoOpenGL as missing:
        pytest.skip(str(missing))
