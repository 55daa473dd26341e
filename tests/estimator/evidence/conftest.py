"""A walk through a synthetic room, and its measurements without objects."""

from __future__ import annotations

from pathlib import Path

import pytest

from estimator.pipeline import measure_objects
from estimator.records.objects import Measurements
from tests.synthetic.walk import Walk, synthetic_walk


@pytest.fixture
def walk(tmp_path: Path) -> Walk:
    return synthetic_walk(tmp_path)


@pytest.fixture
def nothing(walk: Walk) -> Measurements:
    return measure_objects(walk.scene, ())
