from __future__ import annotations

import pytest

from tests.support.skips import skip_without
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene
from tests.synthetic.rooms.render import NoOpenGL
from tests.synthetic.rooms.world import World


@pytest.fixture(scope="session")
def room() -> World:
    return furnished_room("study", 1003)


@pytest.fixture(scope="session")
def synthetic(room: World) -> SyntheticScene:
    with skip_without(NoOpenGL):
        return quick_scene(room, seed=1003)
