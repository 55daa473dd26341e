"""Depth maps in metres, and the baselines of a rig."""

from __future__ import annotations

import json
from pathlib import Path

import pycolmap
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from estimator.evidence.depth_files import read_depth
from estimator.evidence.lengths import RigBaseline, rig_baselines
from estimator.evidence.metric_depth import MetricDepth
from estimator.geometry.measurement import Measurements
from metric_base.errors import InputError
from tests.synthetic.evidence import (
    RIG_M,
    one,
)
from tests.synthetic.walk import Walk, with_rig


def test_a_folder_without_depth_maps(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    assert one(MetricDepth(tmp_path).observe(walk.scene, nothing)).scale is None
    with pytest.raises(InputError, match="no such folder"):
        MetricDepth(tmp_path / "nowhere").observe(walk.scene, nothing)


@pytest.mark.parametrize("name", ["a.npy", "a.pfm", "a.png"])
@given(content=st.binary(max_size=300))
@example(content=b"PK\x03\x04")  # an archive's first bytes
@example(content=b"\x93NUMPY\x01\x00")
def test_damaged_depth_maps_are_one_line(tmp_path_factory: pytest.TempPathFactory, name: str, content: bytes) -> None:
    file = tmp_path_factory.mktemp("depth") / name
    file.write_bytes(content)
    with pytest.raises(InputError, match=name):
        read_depth(file)


def test_the_baseline_of_a_rig(walk: Walk, nothing: Measurements) -> None:
    row = one(RigBaseline("left", "right", RIG_M).observe(with_rig(walk, RIG_M).scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=1e-6)
    assert one(RigBaseline("left", "right", RIG_M).observe(walk.scene, nothing)).scale is None


def test_the_baselines_of_colmaps_rig_configuration(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    """A file that pycolmap reads as well."""
    file = tmp_path / "rig_config.json"
    moved = {
        "image_prefix": "right/",
        "cam_from_rig_rotation": [1, 0, 0, 0],
        "cam_from_rig_translation": [-RIG_M, 0, 0],
    }
    file.write_text(json.dumps([{"cameras": [{"image_prefix": "left/", "ref_sensor": True}, moved]}]), encoding="utf-8")
    assert pycolmap.read_rig_config(file)[0].cameras[1].cam_from_rig.translation[0] == -RIG_M
    (baseline,) = rig_baselines(file)
    row = one(baseline.observe(with_rig(walk, RIG_M).scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=1e-6)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{}",
        '[{"cameras": [{"image_prefix": "a/"}]}]',
        '[{"cameras": [{"image_prefix": "a/", "ref_sensor": true}, {"image_prefix": "b/"}]}]',
        '[{"cameras": [{"image_prefix": "a/", "ref_sensor": true},'
        ' {"image_prefix": "b/", "cam_from_rig_translation": [0, 0]}]}]',
    ],
)
def test_a_rig_configuration_without_a_baseline_is_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "rig_config.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"rig_config\.json") as error:
        rig_baselines(tmp_path / "rig_config.json")
    assert "\n" not in str(error.value)
