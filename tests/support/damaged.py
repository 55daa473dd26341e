"""Damaged scenes and instance files: messages, time and memory of the readers.

    python -m tests.support.damaged            print a table of kind, time, memory and message

Each case is a copy of the small scene with one error. A reader must raise an `InputError` with a message of one line
(exit status 2 of the command); other exceptions are printed as internal errors.
"""

from __future__ import annotations

import json
import shutil
import struct
import sys
import tempfile
import tracemalloc
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimator.instances.instance_reader import read_instances_and_warnings
from estimator.reconstructions.scene_reader import read_scene
from metric_base.errors import InputError
from tests.support.processor_time import processor_seconds
from tests.synthetic.small_scene import write_small_scene

__all__ = ["CASES", "MAX_SECONDS", "Case", "Outcome", "outcome", "outcomes"]

#: Maximum processor time in seconds to refuse a damaged file.
MAX_SECONDS = 1.0

Damage = Callable[[Path], None]


@dataclass(frozen=True, slots=True)
class Case:
    """A kind of damage: the form of the small scene, the function that damages its folder, and the instance file."""

    name: str
    form: str
    damage: Damage
    instances: str | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a case.

    message : text of the InputError; None if the input was accepted or another exception was raised.
    error : exception other than an InputError, a defect of the reader.
    """

    case: Case
    message: str | None
    error: Exception | None
    seconds: float
    peak_bytes: int


def outcome(case: Case, folder: Path) -> Outcome:
    """Read a damaged copy of the small scene in `folder`, to measure the time and the memory."""
    case.damage(folder / case.form)
    message, error = _read(case, folder / case.form)
    seconds = processor_seconds(lambda: _read(case, folder / case.form), MAX_SECONDS)
    tracemalloc.start()
    _read(case, folder / case.form)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return Outcome(case, message, error, seconds, peak)


def _read(case: Case, folder: Path) -> tuple[str | None, Exception | None]:
    try:
        read_instances_and_warnings(read_scene(folder), None if case.instances is None else folder / case.instances)
    except InputError as bad:
        return str(bad), None
    except Exception as other:  # noqa: BLE001 (the table lists it)
        return None, other
    return None, None


def outcomes() -> Iterator[Outcome]:
    """Yield the outcome of every case, each on a new copy of the scene."""
    with tempfile.TemporaryDirectory() as temporary:
        intact = Path(temporary) / "intact"
        write_small_scene(intact)
        # the intact forms are readable, and the times of the cases do not include imports
        for form in ("colmap", "text", "opensfm"):
            read_instances_and_warnings(read_scene(intact / form))
        for index, case in enumerate(CASES):
            copy = Path(temporary) / str(index)
            shutil.copytree(intact, copy)
            yield outcome(case, copy)
            shutil.rmtree(copy)


def _zero_bytes(name: str) -> Damage:
    return _written(name, b"")


def _truncated(name: str, fraction: float) -> Damage:
    """Keep a fraction of a file."""

    def damage(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(len(data) * fraction)])

    return damage


def _patched(name: str, offset: int, layout: str, *values: float) -> Damage:
    """Replace bytes of a file by values in a `struct` layout."""

    def damage(folder: Path) -> None:
        data = bytearray((folder / name).read_bytes())
        struct.pack_into(layout, data, offset, *values)
        (folder / name).write_bytes(data)

    return damage


def _replaced(name: str, old: str, new: str) -> Damage:
    def damage(folder: Path) -> None:
        data = (folder / name).read_bytes()
        assert old.encode() in data, f"{name} does not contain {old}"
        (folder / name).write_bytes(data.replace(old.encode(), new.encode(), 1))

    return damage


def _written(name: str, data: bytes) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).write_bytes(data)

    return damage


def _removed(name: str) -> Damage:
    return lambda folder: (folder / name).unlink()


def _edited(name: str, edit: Callable[[Any], object]) -> Damage:
    """Change a JSON document in place with `edit`."""

    def damage(folder: Path) -> None:
        document = json.loads((folder / name).read_text(encoding="utf-8"))
        edit(document)
        (folder / name).write_text(json.dumps(document), encoding="utf-8")

    return damage


def _line(name: str, record: int, column: int, word: str) -> Damage:
    """Replace a word of a record (comments are not counted) of a text model."""

    def damage(folder: Path) -> None:
        lines = (folder / name).read_text(encoding="utf-8").split("\n")
        row = [row for row, line in enumerate(lines) if not line.startswith("#")][record]
        words = lines[row].split(" ")
        words[column] = word
        lines[row] = " ".join(words)
        (folder / name).write_text("\n".join(lines), encoding="utf-8")

    return damage


def _annotation(**changes: Any) -> Damage:
    return _edited("instances.json", lambda document: document["annotations"][0].update(changes))


def _shot(**changes: Any) -> Damage:
    return _edited("reconstruction.json", lambda document: next(iter(document[0]["shots"].values())).update(changes))


def _lens(**changes: Any) -> Damage:
    return _edited("reconstruction.json", lambda document: next(iter(document[0]["cameras"].values())).update(changes))


def _image(change: Callable[[bytes], bytes]) -> Damage:
    def damage(folder: Path) -> None:
        file = sorted((folder / "instances").glob("*.png"))[0]
        file.write_bytes(change(file.read_bytes()))

    return damage


def _with_false_size(data: bytes) -> bytes:
    """Return a PNG whose header states 2^31 - 1 pixels per side, with a valid checksum."""
    header = data[12:16] + struct.pack(">II", 2**31 - 1, 2**31 - 1) + data[24:29]
    return data[:12] + header + struct.pack(">I", zlib.crc32(header)) + data[33:]


def _emptied(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


def _twice_named(folder: Path) -> None:
    """Give the first two frames of the first camera the same name."""
    _replaced("images.bin", "frame000001", "frame000000")(folder)


_HUGE = 1 << 62
#: Offsets of the first record. images.bin: count (8 bytes), image id (4), quaternion (32), translation (24), camera id
#: (4), name; cameras.bin: count (8), id (4), model (4), width (8), height (8), parameters.
_IMAGE, _CAMERA = 8, 8

CASES: tuple[Case, ...] = (
    Case("no model at all", "colmap", _emptied),
    Case("cameras.bin missing", "colmap", _removed("cameras.bin")),
    Case("points3D.bin missing", "colmap", _removed("points3D.bin")),
    Case("points3D.bin of zero bytes", "colmap", _zero_bytes("points3D.bin")),
    Case("images.bin of zero bytes", "colmap", _zero_bytes("images.bin")),
    Case("cameras.bin truncated by half", "colmap", _truncated("cameras.bin", 0.5)),
    Case("images.bin truncated by half", "colmap", _truncated("images.bin", 0.5)),
    Case("images.bin without its last bytes", "colmap", _truncated("images.bin", 0.999)),
    Case("points3D.bin truncated to 3 %", "colmap", _truncated("points3D.bin", 0.03)),
    Case("points3D.bin truncated by half", "colmap", _truncated("points3D.bin", 0.5)),
    Case("2^62 points", "colmap", _patched("points3D.bin", 0, "<Q", _HUGE)),
    Case("2^62 images", "colmap", _patched("images.bin", 0, "<Q", _HUGE)),
    Case("a million cameras", "colmap", _patched("cameras.bin", 0, "<Q", 10**6)),
    Case("one point fewer than there are", "colmap", _patched("points3D.bin", 0, "<Q", 59)),
    Case("no images", "colmap", _written("images.bin", bytes(8))),
    Case("2^62 observations of a point", "colmap", _patched("points3D.bin", 8 + 43, "<Q", _HUGE)),
    Case("2^62 keypoints of an image", "colmap", _patched("images.bin", _IMAGE + 64 + 29, "<Q", _HUGE)),
    Case("camera model 99", "colmap", _patched("cameras.bin", _CAMERA + 4, "<i", 99)),
    Case("width of zero", "colmap", _patched("cameras.bin", _CAMERA + 8, "<Q", 0)),
    Case("height of 10^15", "colmap", _patched("cameras.bin", _CAMERA + 16, "<Q", 10**15)),
    Case("negative focal length", "colmap", _patched("cameras.bin", _CAMERA + 24, "<d", -300.0)),
    Case("focal length not a number", "colmap", _patched("cameras.bin", _CAMERA + 24, "<d", float("nan"))),
    Case("quaternion not a number", "colmap", _patched("images.bin", _IMAGE + 4, "<d", float("nan"))),
    Case("quaternion of zeros", "colmap", _patched("images.bin", _IMAGE + 4, "<4d", 0.0, 0.0, 0.0, 0.0)),
    Case("translation infinite", "colmap", _patched("images.bin", _IMAGE + 36, "<d", float("inf"))),
    Case("point not a number", "colmap", _patched("points3D.bin", 16, "<d", float("nan"))),
    Case("point at 10^300", "colmap", _patched("points3D.bin", 16, "<d", 1e300)),
    Case("image of a missing camera", "colmap", _patched("images.bin", _IMAGE + 60, "<I", 77)),
    Case("keypoint of a missing point", "colmap", _patched("images.bin", _IMAGE + 64 + 37 + 16, "<Q", 12345)),
    Case("two images of one name", "colmap", _twice_named),
    Case("image name not UTF-8", "colmap", _patched("images.bin", _IMAGE + 64, "<B", 0xFF)),
    Case("text: a word for a number", "text", _line("points3D.txt", 3, 2, "north")),
    Case("text: a camera of three words", "text", _written("cameras.txt", b"1 PINHOLE 640\n")),
    Case("text: camera model unknown", "text", _line("cameras.txt", 0, 1, "WOBBLE")),
    Case("text: a parameter missing", "text", _written("cameras.txt", b"1 PINHOLE 640 480 500 500 320\n")),
    Case("text: keypoints cut off", "text", _written("images.txt", b"1 1 0 0 0 0 0 0 1 a.png\n1.0 2.0\n")),
    Case("text: not UTF-8", "text", _written("images.txt", b"1 1 0 0 0 0 0 0 1 \xff\xfe.png\n\n")),
    Case("text: only comments", "text", _written("images.txt", b"# nothing\n")),
    Case("dense: not a PLY", "colmap", _written("dense.ply", b"solid cube\n")),
    Case("dense: header without an end", "colmap", _written("dense.ply", b"ply\nformat ascii 1.0\n")),
    Case("dense: 10^15 vertices promised", "colmap", _replaced("dense.ply", "vertex 60", "vertex 1" + "0" * 15)),
    Case("dense: one vertex too many", "colmap", _replaced("dense.ply", "vertex 60", "vertex 61")),
    Case("dense: no z", "colmap", _replaced("dense.ply", "float z", "float w")),
    Case("dense: unknown type", "colmap", _replaced("dense.ply", "uchar red", "tuple red")),
    Case("dense: truncated", "colmap", _truncated("dense.ply", 0.5)),
    Case("visibility: another number of points", "colmap", _patched("dense.ply.vis", 0, "<Q", 59)),
    Case("visibility: an absurd list", "colmap", _patched("dense.ply.vis", 8, "<I", 2**32 - 1)),
    Case("visibility: an image that is not there", "colmap", _patched("dense.ply.vis", 12, "<I", 500)),
    Case("visibility: truncated", "colmap", _truncated("dense.ply.vis", 0.7)),
    Case("OpenSfM: not JSON", "opensfm", _truncated("reconstruction.json", 0.5)),
    Case("OpenSfM: zero bytes", "opensfm", _zero_bytes("reconstruction.json")),
    Case("OpenSfM: an endless nesting", "opensfm", _written("reconstruction.json", b"[" * 200_000)),
    Case("OpenSfM: a reference to itself", "opensfm", _written("reconstruction.json", b'[{"$ref": "#/0"}]')),
    Case("OpenSfM: no reconstruction", "opensfm", _written("reconstruction.json", b"[]")),
    Case("OpenSfM: an object for the list", "opensfm", _written("reconstruction.json", b'{"shots": {}}')),
    Case("OpenSfM: no shots", "opensfm", _edited("reconstruction.json", lambda document: document[0]["shots"].clear())),
    Case("OpenSfM: shots as a list", "opensfm", _edited("reconstruction.json", lambda d: d[0].update(shots=[1, 2]))),
    Case("OpenSfM: rotation of two numbers", "opensfm", _shot(rotation=[0.0, 1.0])),
    Case("OpenSfM: rotation not a number", "opensfm", _shot(rotation=[0.0, 1.0, float("nan")])),
    Case("OpenSfM: translation in words", "opensfm", _shot(translation=["a", "b", "c"])),
    Case("OpenSfM: camera missing", "opensfm", _shot(camera="none")),
    Case("OpenSfM: a panorama", "opensfm", _lens(projection_type="spherical")),
    Case("OpenSfM: no focal length", "opensfm", _lens(focal=None)),
    Case("OpenSfM: negative width", "opensfm", _lens(width=-320)),
    Case("OpenSfM: width of 10^5000", "opensfm", _replaced("reconstruction.json", ": 320", ": 1" + "0" * 5000)),
    Case("OpenSfM: a point of two numbers", "opensfm", _edited(
        "reconstruction.json", lambda d: next(iter(d[0]["points"].values())).update(coordinates=[1, 2]))),
    Case("OpenSfM: tracks of words", "opensfm", _written("tracks.csv", b"OPENSFM_TRACKS_VERSION_v2\na\tb\tc\td\te\n")),
    Case("OpenSfM: tracks of two columns", "opensfm", _written("tracks.csv", b"OPENSFM_TRACKS_VERSION_v2\na\tb\n")),
    Case("OpenSfM: tracks of zero bytes", "opensfm", _zero_bytes("tracks.csv")),
    Case("instances: missing", "colmap", _removed("instances.json")),
    Case("instances: zero bytes", "colmap", _zero_bytes("instances.json")),
    Case("instances: a number", "colmap", _written("instances.json", b"17")),
    Case("instances: no annotations", "colmap", _edited("instances.json", lambda d: d["annotations"].clear())),
    Case("instances: of other images", "colmap", _edited(
        "instances.json", lambda d: [image.update(file_name=f"x{image['id']}.png") for image in d["images"]])),
    Case("instances: unknown category", "colmap", _annotation(category_id=999)),
    Case("instances: unknown image", "colmap", _annotation(image_id=999)),
    Case("instances: an id twice", "colmap", _edited("instances.json", lambda d: d["images"].append(d["images"][0]))),
    Case("instances: odd polygon", "colmap", _annotation(segmentation=[[1, 1, 9, 1, 9, 9, 1]])),
    Case("instances: polygon of two corners", "colmap", _annotation(segmentation=[[1, 1, 9, 9]])),
    Case("instances: polygon not a number", "colmap", _annotation(segmentation=[[1, 1, 9, 1, 9, float("nan")]])),
    Case("instances: run lengths too short", "colmap", _annotation(
        segmentation={"size": [240, 320], "counts": [5, 5]})),
    Case("instances: run lengths of another size", "colmap", _annotation(
        segmentation={"size": [24, 32], "counts": [0, 76800]})),
    Case("instances: run lengths of 10^18", "colmap", _annotation(
        segmentation={"size": [240, 320], "counts": [10**18, 5]})),
    Case("instances: compressed nonsense", "colmap", _annotation(segmentation={"size": [240, 320], "counts": "zzzz"})),
    Case("instances: a mask of 10^10 pixels", "colmap", _annotation(
        segmentation={"size": [10**5, 10**5], "counts": [10**10]})),
    Case("instances: negative box", "colmap", _annotation(segmentation=None, bbox=[10, 10, -5, 5])),
    Case("instances: no box and no mask", "colmap", _annotation(segmentation=None, bbox=None)),
    Case("instances: score of 93", "colmap", _annotation(score=93)),
    Case("results without categories", "colmap", _removed("results_categories.json"), "results.json"),
    Case("pictures: truncated", "opensfm", _image(lambda data: data[:80])),
    Case("pictures: not a PNG", "opensfm", _image(lambda data: b"GIF89a" + data)),
    Case("pictures: a size that lies", "opensfm", _image(
        lambda data: data[:16] + struct.pack(">II", 2**31 - 1, 2**31 - 1) + data[24:])),
    Case("pictures: a size that lies, checksum too", "opensfm", _image(_with_false_size)),
    Case("pictures: a value in words", "opensfm", _written("instances/categories.json", b'{"one": "chair"}')),
    Case("pictures: no names", "opensfm", _removed("instances/categories.json")),
)  # fmt: skip


def main() -> int:
    """Print the table; return 1 if a case was accepted, raised another exception, or took a second."""
    slowest, largest, failures = 0.0, 0, 0
    for result in outcomes():
        message = result.message or f"NOT FOUND ({result.error!r})"
        failures += result.message is None or "\n" in result.message or result.seconds >= 1
        slowest, largest = max(slowest, result.seconds), max(largest, result.peak_bytes)
        print(f"{result.case.name:<42} {1000 * result.seconds:6.1f} ms {result.peak_bytes / 1e6:5.1f} MB  {message}")
    maxima = f"slowest {1000 * slowest:.0f} ms, most memory {largest / 1e6:.1f} MB"
    print(f"{len(CASES)} kinds, {failures} without a message of one line within a second; {maxima}")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
