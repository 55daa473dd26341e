"""Every benchmark starts; the comparison of judged ranges."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

from benchmarks.metric_tree import judged_ranges

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in [*(ROOT / "benchmarks").rglob("*.py"), ROOT / "data" / "generate.py"]
    if "    main()" in path.read_text(encoding="utf-8") or "sys.exit(main())" in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_benchmark_explains_itself(name, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as end:
        importlib.import_module(name).main()
    assert end.value.code == 0
    assert len(capsys.readouterr().out) > 150


def test_judged_ranges_are_compared_by_their_widths():
    """Rows from 0.8 to 1.25 times the typical size: a range of them contains nine of ten, a tenth of it few."""
    logs = np.linspace(np.log(0.8), np.log(1.25), 101)
    items = [{"kind": "product", "length_mm": 500 * np.exp(one), "width_mm": None, "height_mm": None} for one in logs]
    node = SimpleNamespace(items=lambda: pa.Table.from_pylist(items), path=("entity", "furniture"))
    tree = SimpleNamespace(node=lambda node_id: node)
    spans = {"low": 500 * 0.8**0.9, "typical": 500.0, "high": 500 * 1.25**0.9}
    narrow = {"low": 500 * 0.8**0.09, "typical": 500.0, "high": 500 * 1.25**0.09}
    (wide,), (thin,) = (
        list(judged_ranges.compared(tree, SimpleNamespace(node_id="a", spans=(tuple(one.values()), (None,) * 3, None))))
        for one in (spans, narrow)
    )
    assert (wide.kind, wide.as_written) == ("furniture", pytest.approx(0.9, abs=0.02))
    assert wide.needed == pytest.approx(1, abs=0.02)
    assert thin.as_written < 0.12
    assert thin.needed == pytest.approx(10, rel=0.02)
    assert wide.widened > wide.as_written
