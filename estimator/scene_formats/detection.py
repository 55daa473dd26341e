"""Recognise the program of a reconstruction by the names and first bytes of its files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from estimator.records.scene import Scene
from estimator.scene_formats.bundler import read_bundler
from estimator.scene_formats.dust3r import read_dust3r
from estimator.scene_formats.gaussian_splatting import read_gaussian_splatting
from estimator.scene_formats.meshroom import read_meshroom
from estimator.scene_formats.metashape import read_metashape
from estimator.scene_formats.nerfstudio import read_nerfstudio
from estimator.scene_formats.networks import network_output, read_network
from estimator.scene_formats.realitycapture import is_realitycapture, read_realitycapture
from estimator.scene_formats.trajectory import is_trajectory, read_trajectory
from metric_base.input_files import folder_entries, read_bytes

#: Names of the files of all programs, for a message.
EXPORT_NAMES = (
    "transforms.json, cameras.json, *.sfm, bundle.out, a Metashape *.xml, a RealityCapture *.csv, or the output of a "
    "network (docs/reference/formats.md)"
)
#: Program of the outputs of networks.
NETWORK = "network"

#: Source of the points for files that contain only cameras.
_POINTS_ADVICE = {
    "meshroom": "let the node ConvertSfMFormat write .sfm with the structure",
    "nerfstudio": "specify the COLMAP model from which it was made",
}

_FIRST_BYTES = 4096
_READERS: dict[str, Callable[[Path], Scene]] = {
    "nerfstudio": read_nerfstudio,
    "meshroom": read_meshroom,
    "bundler": read_bundler,
    "metashape": read_metashape,
    "realitycapture": read_realitycapture,
    "gaussian-splatting": read_gaussian_splatting,
    "dust3r": read_dust3r,
    "trajectory": read_trajectory,
}
#: Advice about files that are not reconstructions, by suffix.
_ADVICE = {
    ".ply": "a point cloud: name the folder with the cameras, and the cloud with --dense",
    **dict.fromkeys((".jpg", ".jpeg", ".png"), "one image: add --depth-map FILE or --points FILE of a network"),
    ".db": "COLMAP's database of matches: run `colmap mapper` and name the model's folder, such as sparse/0",
    ".zip": "an archive: unpack it and name its folder",
    ".gz": "an archive: unpack it and name its folder",
    ".abc": "an Alembic file: let Meshroom's node ConvertSfMFormat write .sfm",
    ".txt": "no trajectory of TUM: time x y z qx qy qz qw in each line, and the cloud in a PLY file of the same name",
    ".psx": "Metashape's project: export its cameras (File, Export, Export Cameras)",
    ".rcproj": "RealityCapture's project: export its registration as CSV",
    ".mg": "Meshroom's project: name the cameras.sfm of its node StructureFromMotion",
    ".json": "JSON of another kind: a transforms.json or reconstruction.json is read; for sizes use --objects FILE",
}


def export_file(path: Path) -> tuple[Path, str] | None:
    """Return the first file of another program at a path or in a folder, and its program; None without such a file."""
    candidates = [path] if path.is_file() else folder_entries(path) if path.is_dir() else []
    for file in candidates:
        is_text = file == path or file.suffix.lower() in {".json", ".sfm", ".out", ".xml", ".csv"}
        program = _program(file) if is_text and file.is_file() else None
        if program is not None:
            return file, program
    output = network_output(path)
    return None if output is None else (output[0], NETWORK)


def read_export(file: Path, program: str) -> Scene:
    """Read a file that `export_file` returned."""
    output = network_output(file) if program == NETWORK else None
    return _READERS[program](file) if output is None else read_network(*output)


def advice_on_file(path: Path) -> str:
    """Return the kind of a file that is not a reconstruction, with advice."""
    return _ADVICE.get(path.suffix.lower(), "a file of another kind: name the folder of the reconstruction")


def points_advice(program: str) -> str:
    """Return the expected points for a file that contains only cameras, for a message."""
    options = ["put points.ply in the same frame into its folder", "specify a cloud with --dense"]
    options += [_POINTS_ADVICE[program]] if program in _POINTS_ADVICE else []
    options += ["reconstruct the folder of its images"]
    return f"at least one sparse or dense point ({', or '.join(options)})"


def _program(file: Path) -> str | None:
    """Return the program of a file by its name, or else by its first bytes."""
    suffix = file.suffix.lower()
    if suffix == ".sfm":
        return "meshroom"
    if file.name.startswith("transforms") and suffix == ".json":
        return "nerfstudio"
    if all(suffix != one for one, _, _ in _SIGNATURES):
        return None
    head = read_bytes(file, most=_FIRST_BYTES).decode("utf-8-sig", "replace")
    return next((program for one, program, matches in _SIGNATURES if one == suffix and matches(head)), None)


#: Suffix, program and test of the first bytes.
_SIGNATURES: tuple[tuple[str, str, Callable[[str], bool]], ...] = (
    (".out", "bundler", lambda head: head.startswith("# Bundle file")),
    (".xml", "metashape", lambda head: "<chunk" in head),
    (".csv", "realitycapture", is_realitycapture),
    (".json", "nerfstudio", lambda head: '"frames"' in head and '"transform_matrix"' in head),
    (".txt", "trajectory", is_trajectory),
    (".glb", "dust3r", lambda head: head.startswith("glTF")),
    (".json", "gaussian-splatting", lambda head: '"img_name"' in head and '"rotation"' in head),
)
