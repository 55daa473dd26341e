"""Boxes of the objects in plain mesh files: OBJ, STL, PLY, OFF (trimesh) and COLLADA (pycollada)."""

from __future__ import annotations

import io
from functools import partial
from pathlib import Path

import numpy as np

from metric_base.errors import damage_as_field_error, in_file
from metric_base.input_files import read_bytes
from models3d.asset import Asset, NameText, Up, body_from_box

#: Maximum size of a file, in bytes.
MAX_BYTES = 1 << 29
#: Values of `up_axis` in the `asset` element of COLLADA.
_UP: dict[str, Up] = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}
#: Convert an error of a library, whose errors have no common base.
_library_errors = partial(damage_as_field_error, found=lambda error: type(error).__name__)


def read_mesh(path: Path) -> Asset:
    """Read the groups of faces of an OBJ, STL, PLY or OFF file; materials and other files are not read.

    Raises
    ------
    InputError
        The file is damaged, too large, or has no vertex.
    """
    import trimesh

    kind = path.suffix.lower().removeprefix(".")
    with in_file(path):
        data = read_bytes(path, limit=MAX_BYTES)
        with _library_errors(f"a readable {kind.upper()} file"):
            options = {"skip_materials": True, "split_objects": True} if kind == "obj" else {}
            loaded = trimesh.load(
                io.BytesIO(data), file_type=kind, process=False, resolver=None, force="scene", **options
            )
            boxes = {name: shape.bounds for name, shape in loaded.geometry.items() if shape.bounds is not None}
        bodies = []
        for name, bounds in boxes.items():
            # trimesh numbers groups without a name: geometry_0, geometry_1, ...
            texts = (NameText("mesh", name),) if not name.startswith("geometry_") else ()
            bodies.append(body_from_box(name, (bounds[0], bounds[1]), 1.0, texts))
    return Asset(path, kind, None, None, tuple(bodies), has_external_files=kind == "obj" and b"mtllib" in data)


def read_collada(path: Path) -> Asset:
    """Read the geometries of a COLLADA file, with the unit and the up axis of its `asset` element.

    Raises
    ------
    InputError
        The file is damaged, too large, or has no vertex.
    """
    import collada

    with in_file(path):
        data = read_bytes(path, limit=MAX_BYTES)
        with _library_errors("a readable COLLADA file"):
            document = collada.Collada(io.BytesIO(data), ignore=[collada.DaeError])
            unit = document.assetInfo.unitmeter
            up = _UP.get(str(document.assetInfo.upaxis))
            bodies = []
            for geometry in document.scene.objects("geometry"):
                clouds = [part.vertex for part in geometry.primitives() if part.vertex is not None and len(part.vertex)]
                if clouds:
                    points = np.concatenate(clouds).astype(float)
                    name = str(geometry.original.name or geometry.original.id or "geometry")
                    box = points.min(axis=0), points.max(axis=0)
                    unit_m = 1.0 if unit is None else float(unit)
                    bodies.append(body_from_box(name, box, unit_m, (NameText("mesh", name),)))
    title = document.assetInfo.title
    return Asset(path, "dae", unit, up, tuple(bodies), (NameText("title", title),) if title else ())
