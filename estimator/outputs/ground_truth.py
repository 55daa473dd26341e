"""What a scene's own `truth.json` knows, for pictures that show truth beside estimate. No estimate reads it."""

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
    """True scale in metres per scene unit, and true sizes in metres by the instances' track and dimension."""

    scale: float | None = None
    sizes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def read_truth(folder: Path) -> SceneTruth:
    """The truth beside a scene, empty where there is none or it is of another form: it only decorates."""
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


def _number(stated: Any) -> float | None:
    """The positive number that is stated, alone or as the `value` of an object, or None."""
    value = stated.get("value") if isinstance(stated, dict) else stated
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < MAX_COORDINATE:
        return None
    return float(value)


def _dimensions(stated: Mapping[str, float | None]) -> dict[str, float]:
    """Length, width and height of what a person measured, whose words are edge, diameter, depth and thickness too.

    The longer horizontal size is the length whatever it was called; an object without a height lies flat, so that
    its thickness is its height; a ball has its diameter in every direction.
    """
    known = {name: value for name, value in stated.items() if value is not None}
    if "edge" in known:
        return dict.fromkeys(("length", "width", "height"), known["edge"])
    if "diameter" in known:
        across = known["diameter"]
        return {"length": across, "width": across, "height": known.get("height", across)}
    height = known.get("height", known.get("thickness"))
    level = [known[name] for name in ("length", "width", "depth") if name in known]
    if "height" in known and "thickness" in known:
        level.append(known["thickness"])
    sizes = dict(zip(("length", "width"), sorted(level, reverse=True), strict=False))
    return sizes if height is None else {**sizes, "height": height}
