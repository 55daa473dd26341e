"""The add-on in Blender itself, where `METRIC_TREE_BLENDER` names a Python that has bpy."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PYTHON = os.environ.get("METRIC_TREE_BLENDER", "")


@pytest.mark.skipif("python" not in Path(PYTHON).name, reason="METRIC_TREE_BLENDER names no Python with bpy")
def test_three_objects_in_centimetres_become_metres(tmp_path: Path) -> None:
    program = Path(sys.executable).with_name("metric-tree")
    script, addon = ROOT / "tests" / "integrations" / "blender_session.py", ROOT / "integrations" / "blender"
    subprocess.run([PYTHON, script, addon, program, tmp_path / "out.json"], check=True, timeout=300)
    answer = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert answer["low"] < 0.01 < answer["high"]
    assert 0.7 < answer["heights"]["Chair.001"] < 1.2
    assert answer["words"].startswith("3 of 3 objects")
