"""The bodies of files of plain meshes: OBJ, STL, PLY, OFF by trimesh, COLLADA by pycollada."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from metric_base.errors import FieldError, Unquoted, expect, in_file
from metric_base.input_files import read_bytes
from models3d.asset import Asset, AssetBody, NameText, Up, body_from_box

#: Largest file of a mesh.
MAX_BYTES = 1 << 29
#: Up axes of COLLADA's `asset`.
_UP: dict[str, Up] = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}


def read_mesh(path: Path) -> Asset:
    """What an OBJ, STL, PLY or OFF file states: its groups of faces. Materials and other files are not read."""
    import trimesh

    kind = path.suffix.lower().removeprefix(".")
    with in_file(path):
        data = read_bytes(path, limit=MAX_BYTES)
        try:
            options = {"skip_materials": True, "split_objects": True} if kind == "obj" else {}
            loaded = trimesh.load(
                io.BytesIO(data), file_type=kind, process=False, resolver=None, force="scene", **options
            )
            boxes = [(name, shape.bounds) for name, shape in loaded.geometry.items() if shape.bounds is not None]
        except Exception as error:  # noqa: BLE001 - a dozen kinds for damaged files, without a common base
            raise FieldError(
                "content", f"a readable {kind.upper()} file", Unquoted(f"{type(error).__name__}")
            ) from None
        expect(bool(boxes), "content", "at least one vertex", Unquoted("none"))
        bodies = tuple(_body(name, np.asarray(bounds, dtype=float)) for name, bounds in boxes)
    return Asset(path, kind, None, None, bodies)


def read_collada(path: Path) -> Asset:
    """What a COLLADA file states, with the unit and the up axis of its `asset`."""
    import collada

    with in_file(path):
        data = read_bytes(path, limit=MAX_BYTES)
        try:
            document = collada.Collada(io.BytesIO(data), ignore=[collada.DaeError])
            unit = document.assetInfo.unitmeter
            up = _UP.get(str(document.assetInfo.upaxis))
            bodies = tuple(_collada_bodies(document, 1.0 if unit is None else float(unit)))
        except FieldError:
            raise
        except Exception as error:  # noqa: BLE001 - its errors and those of its XML reader have no common base
            raise FieldError("content", "a readable COLLADA file", Unquoted(f"{type(error).__name__}")) from None
        expect(bool(bodies), "content", "at least one vertex", Unquoted("none"))
    title = document.assetInfo.title
    return Asset(path, "dae", unit, up, bodies, (NameText("title", title),) if title else ())


def _collada_bodies(document: object, unit_m: float) -> list[AssetBody]:
    bodies = []
    for bound in document.scene.objects("geometry"):  # type: ignore[attr-defined]
        clouds = [part.vertex for part in bound.primitives() if part.vertex is not None and len(part.vertex)]
        if clouds:
            points = np.concatenate(clouds).astype(float)
            name = str(bound.original.name or bound.original.id or "geometry")
            bodies.append(
                body_from_box(name, (points.min(axis=0), points.max(axis=0)), unit_m, (NameText("mesh", name),))
            )
    return bodies


def _body(name: str, bounds: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> AssetBody:
    """The body of corners (2, 3)."""
    words = (NameText("mesh", name),) if not name.startswith("geometry_") else ()
    return body_from_box(name, (bounds[0], bounds[1]), 1.0, words)
