"""Boxes of the objects in a USD file (usd-core); references to files outside its folder are refused."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Ar, Sdf, Usd, UsdGeom

from metric_base.errors import Unquoted, damage_as_field_error, expect, in_file
from models3d.asset import Asset, AssetBody, NameText, Up, body_from_box

#: Maximum size of the file, in bytes.
MAX_BYTES = 1 << 29
#: Maximum number of files that a stage is composed of.
MAX_LAYERS = 500
#: Maximum number of prims after composition: 2 GB and a minute. Files of a few lines that refer to each other twice
#: double the number with each file.
MAX_COMPOSED_PRIMS = 1_000_000
#: Convert an error of the library; Tf.ErrorException is not a Python exception class.
_usd_errors = partial(damage_as_field_error, "a readable USD file", found=lambda error: " ".join(str(error).split()))


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
    with in_file(path):
        expect(path.stat().st_size <= MAX_BYTES, "file", f"at most {MAX_BYTES} bytes", path.stat().st_size)
        # Other files of a stage before it is composed; FieldError if one is outside the folder.
        folder = path.parent.resolve()
        waiting = [str(path.resolve())]
        found, files = set(waiting), {path.resolve()}
        while waiting:
            name = waiting.pop()
            with _usd_errors():
                layer = Sdf.Layer.FindOrOpen(name)
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
        count = _composed_prims(path)
        expect(count <= MAX_COMPOSED_PRIMS, "references", f"at most {MAX_COMPOSED_PRIMS:,} prims", Unquoted("more"))
        with _usd_errors():
            stage = Usd.Stage.Open(str(path))
        unit = float(UsdGeom.GetStageMetersPerUnit(stage))
        up: Up = "z" if str(UsdGeom.GetStageUpAxis(stage)).lower() == "z" else "y"
        expect(0 < unit < np.inf, "metersPerUnit", "a positive number", unit)
        bodies = tuple(_bodies(stage, unit))
        texts: list[NameText] = []
        if model := stage.GetDefaultPrim():
            texts = [NameText("model", model.GetName()), *_labels(model)]
            texts += [label for child in model.GetChildren() for label in _labels(child)]
    return Asset(path, "usd", unit, up, bodies, tuple(texts), has_external_files=len(files) > 1)


def _composed_prims(path: Path) -> int:
    """Return the number of prims of a stage with those of its references, payloads and inherited classes.

    Variants are ignored.
    """
    counts: dict[tuple[str, str], int] = {}

    def prims_below(layer: Any, prim_path: Any) -> int:
        """Return the number of prims at and below a path of a layer; 0 if it is being counted, which is a cycle."""
        key, spec = (layer.identifier, str(prim_path)), layer.GetPrimAtPath(prim_path)
        if key in counts or spec is None:
            return counts.get(key, 0)
        counts[key] = 0
        targets = [(layer, child.path) for child in spec.nameChildren]
        targets += [
            (layer, base) for arcs in (spec.inheritPathList, spec.specializesList) for base in arcs.GetAppliedItems()
        ]
        for arc in (*spec.referenceList.GetAppliedItems(), *spec.payloadList.GetAppliedItems()):
            other = layer if not arc.assetPath else Sdf.Layer.FindOrOpen(layer.ComputeAbsolutePath(arc.assetPath))
            if other is not None:
                targets.append((other, arc.primPath or Sdf.Path(f"/{other.defaultPrim}")))
        counts[key] = 1 + sum(prims_below(*target) for target in targets)
        return counts[key]

    layers = [Sdf.Layer.FindOrOpen(str(path.resolve()))]
    for layer in layers:  # and their sublayers
        if layer is not None and len(layers) <= MAX_LAYERS:
            layers += [Sdf.Layer.FindOrOpen(layer.ComputeAbsolutePath(name)) for name in layer.subLayerPaths]
    return sum(prims_below(layer, prim.path) for layer in layers if layer is not None for prim in layer.rootPrims)


def _bodies(stage: Any, unit_m: float) -> Iterator[AssetBody]:
    """Yield an object for each root prim; of a chain of single children, the last prim is the object."""
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
        for prim in Usd.PrimRange(root):
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
