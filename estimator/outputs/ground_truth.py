"""Read `truth.json` of a scene, for figures that compare estimate and truth. Estimates do not use it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from estimator.records.scene import MAX_COORDINATE
from metric_base.errors import InputError
from metric_base.input_files import read_json

TRUTH = "truth.json"


@dataclass(frozen=True, slots=True)
class SceneTruth:
    """True scale and sizes of a scene."""

    #: Metres per scene unit.
    scale: float | None = None
    #: Sizes in metres, by track of the instances and dimension.
    sizes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def read_truth(folder: Path) -> SceneTruth:
    """Return the truth of a scene; empty if the file is missing or has another format, because it is optional."""
    try:
        document = read_json(folder / TRUTH)
    except InputError:
        return SceneTruth()
    if not isinstance(document, dict):
        return SceneTruth()
    entries = document.get("objects")
    sizes = {
        str(entry["track_id"]): _dimensions({name: _number(value) for name, value in entry["truth_m"].items()})
        for entry in (entries if isinstance(entries, list) else [])
        if isinstance(entry, dict) and isinstance(entry.get("truth_m"), dict) and "track_id" in entry
    }
    return SceneTruth(_number(document.get("metres_per_unit")), sizes)


def _number(entry: Any) -> float | None:
    """Return a positive number, which may be the `value` of an object, or None."""
    value = entry.get("value") if isinstance(entry, dict) else entry
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < MAX_COORDINATE:
        return None
    return float(value)


def _dimensions(measured: Mapping[str, float | None]) -> dict[str, float]:
    """Convert manually measured sizes, which may be called edge, diameter, depth or thickness, to dimensions.

    The longer horizontal size is the length. The thickness of an object without a height is its height, because it is
    on its side. The diameter of a ball is its size in all directions.
    """
    known = {name: value for name, value in measured.items() if value is not None}
    if "edge" in known:
        return dict.fromkeys(("length", "width", "height"), known["edge"])
    if "diameter" in known:
        diameter = known["diameter"]
        return {"length": diameter, "width": diameter, "height": known.get("height", diameter)}
    height = known.get("height", known.get("thickness"))
    horizontal = [known[name] for name in ("length", "width", "depth") if name in known]
    if "height" in known and "thickness" in known:
        horizontal.append(known["thickness"])
    sizes = dict(zip(("length", "width"), sorted(horizontal, reverse=True), strict=False))
    return sizes if height is None else {**sizes, "height": height}
