from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.synthetic.rooms.furnish import tilted_solid
from tests.synthetic.rooms.shapes import CATEGORIES, solid
from tests.synthetic.rooms.sizes import TYPICAL_MM

length = st.floats(0.01, 12.0)


@pytest.mark.parametrize("category", sorted(CATEGORIES))
def test_every_category_has_a_typical_size(category: str) -> None:
    long, wide, high = TYPICAL_MM[category]
    assert long >= wide > 0
    assert high > 0


@given(st.sampled_from(sorted(CATEGORIES)), length, length, length)
def test_solid_has_a_bounding_box_of_exactly_its_size(category: str, x: float, y: float, z: float) -> None:
    mesh = solid(category, np.array([x, y, z]))
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    assert np.allclose(high - low, [x, y, z], rtol=1e-9)
    assert low[2] == 0
    assert np.allclose((low + high)[:2], 0, atol=1e-9)


@given(st.sampled_from(sorted(CATEGORIES)), st.floats(0.05, 0.8), st.floats(0, 6.3))
def test_tilted_solid_touches_the_floor_and_keeps_its_shape(category: str, tilt: float, yaw: float) -> None:
    size = np.array([0.6, 0.4, 0.9])
    upright, tilted = solid(category, size), tilted_solid(category, size, tilt, yaw)
    assert abs(tilted.vertices[:, 2].min()) < 1e-9
    first, second = upright.vertices[:-1] - upright.vertices[1:], tilted.vertices[:-1] - tilted.vertices[1:]
    assert np.allclose(np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1), atol=1e-9)


@pytest.mark.parametrize("category", sorted(CATEGORIES))
def test_faces_refer_to_vertices_and_have_a_material(category: str) -> None:
    mesh = solid(category, np.ones(3))
    assert mesh.faces.min() == 0
    assert mesh.faces.max() == len(mesh.vertices) - 1
    assert len(mesh.material) == len(mesh.faces)
