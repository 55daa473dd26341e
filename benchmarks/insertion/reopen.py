"""Exports read again by other programs: `python -m benchmarks.insertion.reopen EXPORT SCENE`.

EXPORT is what `insert-object SCENE --export EXPORT` wrote. Each form is opened by a reader that is not ours: trimesh,
pygltflib, usd-core, pycolmap, Blender (METRIC_TREE_BLENDER names a Python with bpy), a small reading of what nerfstudio
documents. The vertices of the first object are projected with what it says of the camera, bent by pycolmap's
lens, and their box is compared with the outline that was drawn. Readers that are not installed are left out.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray

assert zlib is not None  # must be loaded before pycolmap

__all__ = ["main"]


@dataclass(frozen=True, slots=True, eq=False)
class Meant:
    """What the export should say.

    boxes : of the outline (x, y, right, below) in each picture that shows it whole; times : seconds of all pictures;
    size_m : of the first object; lens : its model, size and parameters.
    """

    folder: Path
    scene: Path
    boxes: dict[int, FloatArray]
    times: list[float]
    size_m: dict[str, float]
    lens: dict[str, Any]

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        return self.lens["width"], self.lens["height"]


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("export", type=Path)
    parser.add_argument("scene", type=Path, help="folder of the COLMAP model that was exported")
    options = parser.parse_args()
    meant = _meant(options.export, options.scene)
    readers: dict[str, Callable[[Meant], str]] = {
        "scene.glb, trimesh": _by_trimesh,
        "scene.glb, pygltflib": _by_pygltflib,
        "scene.usda, usd-core": _by_usd,
        "transforms.json": _by_nerfstudio,
        "colmap, pycolmap": _by_pycolmap,
        "depth, rays by trimesh": _by_rays,
        **{f"{name}, Blender": _by_blender(name) for name in ("scene.glb", "scene.usda", "scene.blend")},
    }
    print(f"{len(meant.boxes)} pictures show the whole object; height {meant.size_m['height']:.4f} m")
    for name, read in readers.items():
        try:
            print(f"| {name} | {read(meant)} |", flush=True)
        except ModuleNotFoundError as error:
            print(f"| {name} | not tried: {error.name} is not installed |")


def _meant(folder: Path, scene: Path) -> Meant:
    record = json.loads((folder / "insertion.json").read_text())[0]
    header = _gltf_header(folder / "scene.glb")
    lens = header["cameras"][0]["extras"]
    frames = json.loads((folder / "transforms.json").read_text())["frames"]
    posed = {Path(frame["file_path"]).stem for frame in frames}
    boxes = {}
    shown = [frame for frame in record["frames"] if Path(frame["image"]).stem in posed]
    for number, frame in enumerate(shown):
        box = frame["silhouette"]
        if box is None:
            continue
        right, below = box["x"] + box["width"], box["y"] + box["height"]
        if box["x"] > 0 and box["y"] > 0 and right < lens["width"] and below < lens["height"]:
            boxes[number] = np.array([box["x"], box["y"], right, below], dtype=float)
    return Meant(folder, scene, boxes, [frame["time_s"] for frame in frames], record["size_m"], lens)


def _gltf_header(file: Path) -> dict[str, Any]:
    data = file.read_bytes()
    header: dict[str, Any] = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    return header


def _compared(meant: Meant, pixels: Callable[[int], FloatArray]) -> str:
    """Largest and median distance of the edges of the boxes; pixels(k) : (n, 2) ideal pixels of the vertices."""
    errors = []
    for number, box in meant.boxes.items():
        bent = _bent(meant, pixels(number))
        errors.append(np.abs(np.concatenate([bent.min(axis=0), bent.max(axis=0)]) - box).max())
    return f"outline's box: {np.median(errors):.2f} px median, {max(errors):.2f} px at most"


def _bent(meant: Meant, ideal: FloatArray) -> FloatArray:
    """(n, 2) pixels through the lens of (n, 2) pixels without."""
    import pycolmap

    lens = pycolmap.Camera(
        model=meant.lens["model"], width=meant.lens["width"], height=meant.lens["height"], params=meant.lens["params"]
    )
    rays = np.column_stack([(ideal - lens.calibration_matrix()[:2, 2]) / np.diag(lens.calibration_matrix())[:2],
                            np.ones(len(ideal))])  # fmt: skip
    return np.asarray(lens.img_from_cam(rays))


def _through(matrix: FloatArray, points: FloatArray, focal: FloatArray, centre: FloatArray) -> FloatArray:
    """(n, 2) pixels of (n, 3) world points; matrix (4, 4) camera to world, OpenGL's axes."""
    local = (points - matrix[:3, 3]) @ matrix[:3, :3]
    return np.asarray(centre + focal * local[:, :2] * [1, -1] / -local[:, 2:])


def _by_trimesh(meant: Meant) -> str:
    import trimesh

    extents = trimesh.load_scene(meant.folder / "scene.glb").extents
    return f"height {extents[1]:.4f} m"


def _by_pygltflib(meant: Meant) -> str:
    from pygltflib import GLTF2
    from scipy.spatial.transform import Rotation

    document = GLTF2().load(str(meant.folder / "scene.glb"))
    blob = document.binary_blob()

    def values(number: int) -> FloatArray:
        accessor = document.accessors[number]
        view = document.bufferViews[accessor.bufferView]
        columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
        start = view.byteOffset or 0
        return np.frombuffer(blob, "<f4", accessor.count * columns, start).reshape(-1, columns).astype(float)

    node = document.nodes[0]
    matrix = np.array(node.matrix).reshape(4, 4).T
    parts = [values(part.attributes.POSITION) for part in document.meshes[node.mesh].primitives]
    points = np.concatenate(parts) @ matrix[:3, :3].T + matrix[:3, 3]
    lens = document.cameras[0].perspective
    width, height = meant.size_px
    focal = height / 2 / np.tan(lens.yfov / 2) * np.array([1.0, 1.0])
    focal[0] *= width / height / lens.aspectRatio
    channels = {channel.target.path: channel.sampler for channel in document.animations[0].channels}
    samplers = document.animations[0].samplers
    moves = {path: values(samplers[row].output) for path, row in channels.items()}
    times = values(samplers[0].input)[:, 0]

    def pixels(number: int) -> FloatArray:
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat(moves["rotation"][number]).as_matrix()
        pose[:3, 3] = moves["translation"][number]
        return _through(pose, points, focal, np.array([width, height]) / 2)

    late = np.abs(times - meant.times).max()
    return f"height {np.ptp(points[:, 1]):.4f} m; {_compared(meant, pixels)}; times off by {late * 1000:.2g} ms at most"


def _by_usd(meant: Meant) -> str:
    from pxr import Usd, UsdGeom, UsdValidation

    stage = Usd.Stage.Open(str(meant.folder / "scene.usda"))
    points = []
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh) and str(prim.GetPath()).startswith("/World/object0/"):
            matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0)).T
            points.append(np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get()) @ matrix[:3, :3].T + matrix[:3, 3])
    corners = np.concatenate(points)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/camera"))
    width, height = meant.size_px

    def pixels(number: int) -> FloatArray:
        view = camera.GetCamera(meant.times[number] * stage.GetTimeCodesPerSecond())
        window = view.frustum.window
        low, high = np.array(window.GetMin()), np.array(window.GetMax())
        pose = np.array(view.transform).T
        local = (corners - pose[:3, 3]) @ pose[:3, :3]
        share = (local[:, :2] / -local[:, 2:] - low) / (high - low)
        return np.asarray(share * [1, -1] * [width, height] + [0, height])

    errors = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators()).Validate(
        stage
    )
    units = f"metersPerUnit {UsdGeom.GetStageMetersPerUnit(stage):g}, upAxis {UsdGeom.GetStageUpAxis(stage)}, "
    units += f"{stage.GetTimeCodesPerSecond():.4g} time codes a second"
    names = sorted({error.GetName() for error in errors})
    return (
        f"{units}; height {np.ptp(corners[:, 1]):.4f} m; {_compared(meant, pixels)}; validators: {names or 'no error'}"
    )


def _by_nerfstudio(meant: Meant) -> str:
    """As nerfstudio's documentation says: OpenGL's axes, +z up, pixels from the corner of the first."""
    document = json.loads((meant.folder / "transforms.json").read_text())
    corners = _corners(meant)[:, [0, 2, 1]] * [1, -1, 1]  # glTF's +y up to +z up
    first = document | document["frames"][0]
    focal, centre = np.array([first["fl_x"], first["fl_y"]]), np.array([first["cx"], first["cy"]])

    def pixels(number: int) -> FloatArray:
        return _through(np.array(document["frames"][number]["transform_matrix"]), corners, focal, centre)

    missing = sum(not (meant.folder / frame["file_path"]).is_file() for frame in document["frames"])
    return f"{_compared(meant, pixels)}; {missing} pictures are not there"


def _corners(meant: Meant) -> FloatArray:
    """(n, 3) vertices of the first object by trimesh."""
    import trimesh

    scene = trimesh.load_scene(meant.folder / "scene.glb", process=False)
    return np.asarray(scene.to_geometry().vertices)


def _by_pycolmap(meant: Meant) -> str:
    import pycolmap

    before, after = (_model(folder) for folder in (meant.scene, meant.folder / "colmap"))
    scale = float((meant.folder / "colmap" / "metric_transform.txt").read_text().split()[0])
    assert isinstance(before, pycolmap.Reconstruction)
    worst = 0.0
    for key, image in before.images.items():
        other = after.images[key]
        worst = max(worst, float(np.abs(image.projection_center() * scale - other.projection_center()).max()))
    points = np.array([point.xyz for point in before.points3D.values()]) * scale
    moved = np.abs(points - np.array([after.points3D[key].xyz for key in before.points3D])).max()
    error = after.compute_mean_reprojection_error()
    return (
        f"centres within {worst:.1g} m, points within {moved:.1g} m of the scaled ones; {error:.3f} px of reprojection"
    )


def _model(folder: Path) -> Any:
    import pycolmap

    return pycolmap.Reconstruction(next(folder.rglob("images.bin")).parent)


def _by_rays(meant: Meant) -> str:
    """The depth along the optical axis by rays through every twentieth pixel of the mask."""
    import cv2
    import pycolmap
    import trimesh

    mesh = trimesh.load_scene(meant.folder / "scene.glb", process=False).to_geometry()
    document = json.loads((meant.folder / "transforms.json").read_text())
    lens = pycolmap.Camera(**{name: meant.lens[name] for name in ("model", "width", "height", "params")})
    turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=float)  # +z up to +y up
    errors = []
    for number in list(meant.boxes)[:: max(1, len(meant.boxes) // 3)]:
        frame = document["frames"][number]
        name = f"{Path(frame['file_path']).stem}_0.png"
        depth = cv2.imread(str(meant.folder / "depth" / name), cv2.IMREAD_UNCHANGED)
        mask = cv2.imread(str(meant.folder / "mask" / name), cv2.IMREAD_UNCHANGED)
        assert depth is not None, name
        assert mask is not None, name
        inner = cv2.erode((mask == 255).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        rows, columns = (index[::20] for index in np.nonzero(inner))
        rays = lens.cam_from_img(np.column_stack([columns, rows]) + 0.5)
        rays = np.column_stack([rays[:, :2], np.ones(len(rays))]) * [1, -1, -1]
        pose = np.array(frame["transform_matrix"])
        along, start = rays @ (turn @ pose[:3, :3]).T, turn @ pose[:3, 3]
        hits, index, _ = mesh.ray.intersects_location(np.tile(start, (len(along), 1)), along, multiple_hits=False)
        away = (hits - start) @ (turn @ pose[:3, :3])[:, 2] * -1000
        errors.append(np.abs(away - depth[rows[index], columns[index]]))
    both = np.concatenate(errors)
    return f"{len(both)} pixels: {np.median(both):.1f} mm median, {np.percentile(both, 95):.1f} mm at 95 %"


def _by_blender(name: str) -> Callable[[Meant], str]:
    def read(meant: Meant) -> str:
        program, file = os.environ.get("METRIC_TREE_BLENDER", ""), meant.folder / name
        if "python" not in Path(program).name or not file.is_file():
            raise ModuleNotFoundError(name="bpy, or the file,")
        chosen = list(meant.boxes)[:: max(1, (len(meant.boxes) - 1) // 2)][:3]
        script = Path(__file__).with_name("reopen_in_blender.py")
        words = [program, script, file, *meant.size_px, *(meant.times[number] for number in chosen)]
        clean = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True, env=clean, check=False)
        assert "SAW" in done.stdout, done.stderr[-2000:]
        saw = json.loads(done.stdout.partition("SAW")[2].splitlines()[0])
        width, height = meant.size_px
        shares = {number: np.array(rows)[:, :2] for number, rows in zip(chosen, saw["pixels"], strict=True)}
        few = Meant(
            meant.folder, meant.scene, {k: meant.boxes[k] for k in chosen}, meant.times, meant.size_m, meant.lens
        )
        text = _compared(few, lambda number: shares[number] * [width, -height] + [0, height])
        lens = f"lens {saw['lens_mm']:.2f} of {saw['sensor_mm']:.2f} mm, {saw['rate']:.4g} frames a second"
        return f"height {saw['extents_m'][2]:.4f} m; {lens}; {len(chosen)} pictures: {text}"

    return read


if __name__ == "__main__":
    main()
