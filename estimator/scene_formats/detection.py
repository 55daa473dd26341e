"""Which program a reconstruction comes from, by the names and first bytes of its files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from estimator.records.scene import Scene
from estimator.scene_formats.bundler import read_bundler
from estimator.scene_formats.meshroom import read_meshroom
from estimator.scene_formats.metashape import read_metashape
from estimator.scene_formats.nerfstudio import read_nerfstudio
from estimator.scene_formats.realitycapture import is_realitycapture, read_realitycapture
from metric_base.input_files import folder_entries, read_bytes

#: What the files of the exports are called, for a message.
EXPORT_NAMES = "transforms.json, *.sfm, bundle.out, a Metashape *.xml, a RealityCapture *.csv"

#: Where an export that has cameras alone has its points.
_POINTS_ADVICE = {
    "meshroom": "let the node ConvertSfMFormat write .sfm with the structure",
    "nerfstudio": "name the COLMAP model that it was made of",
}

_FIRST_BYTES = 4096
_READERS: dict[str, Callable[[Path], Scene]] = {
    "nerfstudio": read_nerfstudio,
    "meshroom": read_meshroom,
    "bundler": read_bundler,
    "metashape": read_metashape,
    "realitycapture": read_realitycapture,
}
#: What to do with a file that is no reconstruction, by its ending.
_ADVICE = {
    ".ply": "a point cloud: name the folder with the cameras, and the cloud with --dense",
    ".db": "COLMAP's database of matches: run `colmap mapper` and name the model's folder, such as sparse/0",
    ".zip": "an archive: unpack it and name its folder",
    ".gz": "an archive: unpack it and name its folder",
    ".abc": "an Alembic file: let Meshroom's node ConvertSfMFormat write .sfm",
    ".psx": "Metashape's project: export its cameras (File, Export, Export Cameras)",
    ".rcproj": "RealityCapture's project: export its registration as CSV",
    ".mg": "Meshroom's project: name the cameras.sfm of its node StructureFromMotion",
    ".json": "JSON of another kind: a transforms.json or reconstruction.json is read; for sizes use --objects FILE",
}


def export_file(path: Path) -> tuple[Path, str] | None:
    """The file of an export and its program: `path` itself, or the first in a folder that is one; None if none is."""
    if path.is_file():
        program = _program(path)
        return None if program is None else (path, program)
    if not path.is_dir():
        return None
    for file in folder_entries(path):
        if file.suffix.lower() in {".json", ".sfm", ".out", ".xml", ".csv"} and file.is_file():
            program = _program(file)
            if program is not None:
                return file, program
    return None


def read_export(file: Path, program: str) -> Scene:
    """The scene of a file that `export_file` named."""
    return _READERS[program](file)


def advice_on_file(path: Path) -> str:
    """What a file is that was named in place of a reconstruction, and what to do."""
    return _ADVICE.get(path.suffix.lower(), "a file of another kind: name the folder of the reconstruction")


def points_advice(program: str) -> str:
    """What is expected where the file of a program states cameras and no points."""
    own = _POINTS_ADVICE.get(program)
    ways = ["put points.ply in the same frame beside it", "name a cloud with --dense", *([] if own is None else [own])]
    return f"at least one sparse or dense point ({', or '.join(ways)})"


def _program(file: Path) -> str | None:
    """The program that wrote a file, by its name, else by its first bytes."""
    suffix = file.suffix.lower()
    if suffix == ".sfm":
        return "meshroom"
    if file.name.startswith("transforms") and suffix == ".json":
        return "nerfstudio"
    if suffix not in _SIGNS:
        return None
    program, is_one = _SIGNS[suffix]
    return program if is_one(read_bytes(file, most=_FIRST_BYTES).decode("utf-8-sig", "replace")) else None


#: Program and sign, by ending, of files whose name says nothing.
_SIGNS: dict[str, tuple[str, Callable[[str], bool]]] = {
    ".out": ("bundler", lambda head: head.startswith("# Bundle file")),
    ".xml": ("metashape", lambda head: "<chunk" in head),
    ".csv": ("realitycapture", is_realitycapture),
    ".json": ("nerfstudio", lambda head: '"frames"' in head and '"transform_matrix"' in head),
}
