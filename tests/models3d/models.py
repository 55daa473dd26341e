"""Models of a chair in every format that is read, written by other programs or by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

#: Extents of the chair in metres, y up: as wide, high and deep as chairs are.
CHAIR = np.array([0.48, 0.86, 0.52])

URDF = """<robot name="office_chair"><link name="base"><visual><origin rpy="1.5707963 0 0"/><geometry>
<mesh filename="package://here/chair.obj" scale="{scale} {scale} {scale}"/></geometry></visual></link>
<link name="back"><visual><geometry><box size="{box}"/></geometry></visual></link>
<joint name="j" type="fixed"><parent link="base"/><child link="back"/><origin xyz="0 0 {lift}"/></joint></robot>"""
MJCF = """<mujoco model="chair"><asset><mesh name="c" file="chair.obj" scale="{scale} {scale} {scale}"/></asset>
<worldbody><body name="chair"><geom type="mesh" mesh="c" euler="90 0 0"/></body></worldbody></mujoco>"""
SDF = """<sdf version="1.7"><model name="chair"><link name="l"><visual name="v"><geometry><box><size>{box}</size></box>
</geometry></visual></link></model></sdf>"""
USDA = """#usda 1.0
(
    defaultPrim = "Chair"
    metersPerUnit = {unit}
    upAxis = "Y"
)

def Xform "Chair"
{{
    def Cube "seat" (
        prepend apiSchemas = ["SemanticsLabelsAPI:category"]
    )
    {{
        double size = 1
        token[] semantics:labels:category = ["chair"]
        float3 xformOp:scale = (0.48, 0.86, 0.52)
        uniform token[] xformOpOrder = ["xformOp:scale"]
    }}
}}
"""


def chair(factor: float = 1.0) -> trimesh.Trimesh:
    """A box as large as a chair, standing on the floor, y up; its size is the true one times `factor`."""
    box = trimesh.creation.box(CHAIR)
    box.apply_translation((0, CHAIR[1] / 2, 0))
    box.apply_scale(factor)
    return box


def write_chair(folder: Path, ending: str, factor: float = 1.0) -> Path:
    """A chair in a format, its stated size the true one times `factor`."""
    path = folder / f"chair.{ending}"
    if ending in {"urdf", "mjcf"}:
        chair().export(folder / "chair.obj")
    text = {
        "usda": lambda: USDA.format(unit=factor),
        "urdf": lambda: URDF.format(
            scale=factor, box=f"{0.1 * factor} {0.1 * factor} {0.1 * factor}", lift=0.5 * factor
        ),
        "mjcf": lambda: MJCF.format(scale=factor),
        "sdf": lambda: SDF.format(box=" ".join(str(one * factor) for one in CHAIR[[0, 2, 1]])),
    }
    if ending in text:
        path.write_text(text[ending](), encoding="utf-8")
    elif ending == "ascii.ply":
        path = folder / "chair.ply"
        chair(factor).export(path, encoding="ascii")
    elif ending == "ascii.stl":
        path = folder / "chair.stl"
        chair(factor).export(path, file_type="stl_ascii")
    elif ending == "usdz":
        _write_usdz(folder, path, factor)
    else:
        chair(factor).export(path)
    return path


def _write_usdz(folder: Path, path: Path, factor: float) -> None:
    from pxr import UsdUtils

    source = folder / "source.usda"
    source.write_text(USDA.format(unit=factor), encoding="utf-8")
    assert UsdUtils.CreateNewUsdzPackage(str(source), str(path))
    source.unlink()
