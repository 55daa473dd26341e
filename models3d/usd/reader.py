"""The bodies of a USD file, by usd-core; references that lead out of the model's folder are refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.errors import FieldError, Unquoted, expect, in_file
from models3d.asset import Asset, AssetBody, NameText, Up, body_from_box

#: Largest file, most files that it may be composed of, most prims.
MAX_BYTES, MAX_LAYERS, MAX_PRIMS = 1 << 29, 500, 200_000


def read_usd(path: Path) -> Asset:
    """What a USD file states in its default time, with `metersPerUnit` and `upAxis`.

    Where it states no unit, USD's rule is centimetres, and no up axis is y.
    """
    from pxr import Usd, UsdGeom

    with in_file(path):
        expect(path.stat().st_size <= MAX_BYTES, "file", f"at most {MAX_BYTES} bytes", path.stat().st_size)
        _check_layers(path)
        try:
            stage = Usd.Stage.Open(str(path))
        except Exception as error:  # noqa: BLE001 - Tf.ErrorException, which is no class of Python's
            raise FieldError("content", "a readable USD file", Unquoted(" ".join(str(error).split()))) from None
        unit = float(UsdGeom.GetStageMetersPerUnit(stage))
        up: Up = "z" if str(UsdGeom.GetStageUpAxis(stage)).lower() == "z" else "y"
        expect(0 < unit < np.inf, "metersPerUnit", "a positive number", unit)
        bodies = tuple(_bodies(stage, unit))
        expect(bool(bodies), "content", "at least one shape", Unquoted("none"))
        words = tuple(_stage_words(stage))
    return Asset(path, "usd", unit, up, bodies, words)


def _check_layers(path: Path) -> None:
    """FieldError if a file that takes part is outside the folder, or there are too many; nothing is composed yet."""
    from pxr import Sdf

    folder = path.parent.resolve()
    waiting, known = [path.resolve()], {path.resolve()}
    while waiting:
        file = waiting.pop()
        try:
            layer = Sdf.Layer.FindOrOpen(str(file))
        except Exception as error:  # noqa: BLE001 - as above
            raise FieldError("content", "a readable USD file", Unquoted(" ".join(str(error).split()))) from None
        if layer is None:
            expect(file != path.resolve(), "content", "a readable USD file", Unquoted("another"))
            continue
        for name in layer.GetCompositionAssetDependencies() if path.suffix.lower() != ".usdz" else ():
            target = (file.parent / name).resolve()
            expect(target.is_relative_to(folder), "reference", "a file in the folder of the model", name)
            if target not in known:
                known.add(target)
                waiting.append(target)
        expect(len(known) <= MAX_LAYERS, "references", f"at most {MAX_LAYERS} files", len(known))


def _bodies(stage: Any, unit_m: float) -> Iterator[AssetBody]:
    from pxr import Usd, UsdGeom

    purposes = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render]
    boxes = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), purposes, useExtentsHint=False)
    roots = [prim for prim in stage.GetPseudoRoot().GetChildren() if prim.IsActive()]
    while len(roots) == 1 and not roots[0].IsA(UsdGeom.Gprim) and roots[0].GetChildren():
        roots = list(roots[0].GetChildren())
    for prim in roots:
        box = boxes.ComputeWorldBound(prim).ComputeAlignedRange()
        if not box.IsEmpty():
            words = tuple(_prim_words(prim))
            yield body_from_box(prim.GetName(), (np.array(box.GetMin()), np.array(box.GetMax())), unit_m, words)


def _stage_words(stage: Any) -> Iterator[NameText]:
    prim = stage.GetDefaultPrim()
    if prim:
        yield NameText("model", prim.GetName())
        yield from _labels(prim)
        for above in prim.GetChildren():
            yield from _labels(above)


def _prim_words(prim: Any) -> Iterator[NameText]:
    from pxr import Usd

    for number, one in enumerate(Usd.PrimRange(prim)):
        if number > MAX_PRIMS:
            return
        yield from _labels(one)
        yield NameText("material" if one.GetTypeName() == "Material" else "node", one.GetName())


def _labels(prim: Any) -> Iterator[NameText]:
    """Semantic labels: `semantics:labels:*` (UsdSemantics) and the older `semantic:...:params:semanticData`."""
    for attribute in prim.GetAttributes():
        name = attribute.GetName()
        if name.startswith(("semantics:labels:", "semantic:")) and not name.endswith("semanticType"):
            value = attribute.Get()
            for text in [value] if isinstance(value, str) else list(value or ()):
                yield NameText("semantic", str(text))
