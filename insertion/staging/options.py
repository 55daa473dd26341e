"""What the caller asks for: one object, its size, its place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from insertion.places.request import At

__all__ = ["ObjectRequest", "ScaleUsed", "read_scale"]

from insertion.records.result import ScaleUsed
from metric_base.faults import InputFault


@dataclass(frozen=True, slots=True)
class ObjectRequest:
    """One object.

    model : its file; size : the words of `--size`; at : a point in a picture; on : a category; plane and xy_m : a plane
    and metres along its axes from its middle; without any of these, free space. facing : `camera`, `wall` or degrees;
    category : for `--size prior`.
    """

    model: Path
    size: str = "file"
    at: At | None = None
    on: str | None = None
    plane: int | None = None
    xy_m: tuple[float, float] = (0.0, 0.0)
    facing: float | str = "camera"
    category: str | None = None


def read_scale(folder: Path, stated: float | None) -> ScaleUsed:
    """The scale that `--scale` states, else that of `result.json` in the folder.

    Raises InputFault where there is neither, or the result is not resolved.
    """
    import json

    if stated is not None:
        if not 0 < stated < float("inf"):
            raise InputFault(f"--scale: expected metres per scene unit, above 0; found {stated}")
        return ScaleUsed(stated, None, None, "option")
    file = folder / "result.json"
    if not file.is_file():
        how = f"--scale METRES_PER_UNIT, or {file} (estimate-scale {folder} --output {file})"
        raise InputFault(f"{folder}: scale: expected {how}; found neither")
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        if not str(record["schema"]).startswith("metric-tree/scale/1"):
            raise InputFault(f"{file}: schema: expected metric-tree/scale/1; found {record['schema']!r}")
        if record["status"] != "resolved" or record["scale"] is None:
            raise InputFault(f"{file}: status: expected resolved; found {record['status']!r} (state --scale)")
        interval = record.get("interval") or {}
        return ScaleUsed(float(record["scale"]), interval.get("low"), interval.get("high"), "result")
    except (ValueError, KeyError, TypeError) as fault:
        if isinstance(fault, InputFault):
            raise
        raise InputFault(
            f"{file}: expected a result of estimate-scale; found {type(fault).__name__}: {fault}"
        ) from None
