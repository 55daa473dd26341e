"""Metadata tracks of real cameras: a hand-held GoPro and a GoPro on a drone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.estimator.real_footage import sensor_rows
from estimator.evidence.gps import east_north_up
from estimator.telemetry.readers import read_telemetry


def test_inertial_and_gps_scales_of_a_walk_are_true(shared: Path) -> None:
    """The true scale is 1.10 +- 0.02."""
    rows = {row.kind: row for part, row in sensor_rows(shared / "data/scenes/walk_carpark") if part == "whole"}
    assert rows["imu"].scale == pytest.approx(1.10, rel=0.02)
    assert rows["gps_video"].scale == pytest.approx(1.10, rel=0.04)
    for row in rows.values():
        assert row.sd_log is not None
        assert 0.01 < row.sd_log < 0.05


def test_telemetry_of_a_drone_has_gravity_and_a_plausible_track(shared: Path) -> None:
    telemetry = read_telemetry(shared / "data/scenes/gopro_karma_coast/video.mp4")
    assert len(telemetry.specific_force) > 2000
    assert np.linalg.norm(telemetry.specific_force.values.mean(axis=0)) == pytest.approx(9.8, abs=0.3)
    assert telemetry.positions is not None
    track = east_north_up(telemetry.positions.positions)
    assert 5 < np.linalg.norm(track[-1] - track[0]) < 200
