"""Boxes of the objects in a USD file (usd-core); references to files outside its folder are refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.errors import FieldError, Unquoted, expect, in_file
from models3d.asset import Asset, AssetBody, NameText, Up, body_from_box

#: Maximum size of the file, in bytes.
MAX_BYTES = 1 << 29
#: Maximum number of files that a stage is composed of.
MAX_LAYERS = 500
#: Maximum number of prims of an object whose names are read.
MAX_PRIMS = 200_000


def read_usd(path: Path) -> Asset:
    """Read a USD file at its earliest time.

    Parameters
    ----------
    path : Path
        A `.usd`, `.usda`, `.usdc` or `.usdz` file.

    Returns
    -------
    Asset
        The unit is `metersPerUnit`, by default 0.01, and the up axis is `upAxis`, by default y.

    Raises
    ------
    InputError
        The file is damaged, too large, refers to files outside its folder, or has no shape.
    """
    from pxr import Usd, UsdGeom

    with in_file(path):
        expect(path.stat().st_size <= MAX_BYTES, "file", f"at most {MAX_BYTES} bytes", path.stat().st_size)
        # Other files of a stage before it is composed; FieldError if one is outside the folder.
        from pxr import Ar, Sdf

        folder = path.parent.resolve()
        waiting = [str(path.resolve())]
        found, files = set(waiting), {path.resolve()}
        while waiting:
            name = waiting.pop()
            try:
                layer = Sdf.Layer.FindOrOpen(name)
            except Exception as error:  # noqa: BLE001 - Tf.ErrorException is not a Python exception class
                raise FieldError("content", "a readable USD file", Unquoted(" ".join(str(error).split()))) from None
            if layer is None:
                expect(name != str(path.resolve()), "content", "a readable USD file", Unquoted("another"))
                continue
            for written in layer.GetCompositionAssetDependencies():
                # a file, or a file of a package in the form `package.usdz[file]`
                target = layer.ComputeAbsolutePath(written)
                file = path.parent.joinpath(Ar.SplitPackageRelativePathOuter(target)[0]).resolve()
                expect(file.is_relative_to(folder), "reference", "a file in the folder of the model", written)
                files.add(file)
                if target not in found:
                    found.add(target)
                    waiting.append(target)
            expect(len(found) <= MAX_LAYERS, "references", f"at most {MAX_LAYERS} files", len(found))
        external_files = files - {path.resolve()}
        try:
            stage = Usd.Stage.Open(str(path))
        except Exception as error:  # noqa: BLE001 - Tf.ErrorException is not a Python exception class
            raise FieldError("content", "a readable USD file", Unquoted(" ".join(str(error).split()))) from None
        unit = float(UsdGeom.GetStageMetersPerUnit(stage))
        up: Up = "z" if str(UsdGeom.GetStageUpAxis(stage)).lower() == "z" else "y"
        expect(0 < unit < np.inf, "metersPerUnit", "a positive number", unit)
        bodies = tuple(_bodies(stage, unit))
        expect(bool(bodies), "content", "at least one shape", Unquoted("none"))
        texts: list[NameText] = []
        if model := stage.GetDefaultPrim():
            texts = [NameText("model", model.GetName()), *_labels(model)]
            texts += [label for child in model.GetChildren() for label in _labels(child)]
    return Asset(path, "usd", unit, up, bodies, tuple(texts), has_external_files=bool(external_files))


def _bodies(stage: Any, unit_m: float) -> Iterator[AssetBody]:
    """Yield an object for each root prim; of a chain of single children, the last prim is the object."""
    from pxr import Usd, UsdGeom

    purposes = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render]
    boxes = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), purposes, useExtentsHint=False)
    roots = [prim for prim in stage.GetPseudoRoot().GetChildren() if prim.IsActive()]
    while len(roots) == 1 and not roots[0].IsA(UsdGeom.Gprim) and roots[0].GetChildren():
        roots = list(roots[0].GetChildren())
    for root in roots:
        box = boxes.ComputeWorldBound(root).ComputeAlignedRange()
        if box.IsEmpty():
            continue
        texts: list[NameText] = []
        for index, prim in enumerate(Usd.PrimRange(root)):
            if index > MAX_PRIMS:
                break
            texts += _labels(prim)
            texts.append(NameText("material" if prim.GetTypeName() == "Material" else "node", prim.GetName()))
        corners = np.array(box.GetMin()), np.array(box.GetMax())
        yield body_from_box(root.GetName(), corners, unit_m, tuple(texts))


def _labels(prim: Any) -> Iterator[NameText]:
    """Yield semantic labels: `semantics:labels:*` (UsdSemantics) and the older `semantic:...:params:semanticData`."""
    for attribute in prim.GetAttributes():
        name = attribute.GetName()
        if name.startswith(("semantics:labels:", "semantic:")) and not name.endswith("semanticType"):
            value = attribute.Get()
            for text in [value] if isinstance(value, str) else list(value or ()):
                yield NameText("semantic", str(text))
