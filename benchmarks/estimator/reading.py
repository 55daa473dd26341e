"""How long large models take to read.

    python -m benchmarks.estimator.reading [POINTS]       seconds and memory per form, one million points by default

The model is made of random numbers: POINTS points, 100 images with three observations a point in all.
"""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from estimator.reading import read_scene

__all__ = ["write_large_model"]

IMAGES, SIZE = 100, (1000, 800)
FORMS = ("binary", "text", "opensfm")


def write_large_model(folder: Path, n_points: int, seed: int = 0) -> None:
    """The same random model as COLMAP binary, COLMAP text and OpenSfM, with a dense cloud beside the binary."""
    rng = np.random.default_rng(seed)
    for form in FORMS:
        (folder / form).mkdir(parents=True)
    points = rng.normal(size=(n_points, 3)).round(6)
    seen = np.array_split(rng.permutation(np.repeat(np.arange(n_points), 3)), IMAGES)
    pixels = [(rng.random((len(rows), 2)) * SIZE).round(3) for rows in seen]
    tracks = _tracks(seen, n_points)
    _write_binary(folder / "binary", points, seen, pixels, tracks)
    _write_text(folder / "text", points, seen, pixels, tracks)
    _write_opensfm(folder / "opensfm", points, seen, pixels)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {n_points}\n"
    header += "property float x\nproperty float y\nproperty float z\nend_header\n"
    (folder / "binary" / "dense.ply").write_bytes(header.encode("ascii") + points.astype("<f4").tobytes())


def _tracks(seen: list[np.ndarray], n_points: int) -> list[list[int]]:
    """Image id and keypoint of every observation, by point, flat."""
    tracks: list[list[int]] = [[] for _ in range(n_points)]
    for image, rows in enumerate(seen, start=1):
        for keypoint, point in enumerate(rows.tolist()):
            tracks[point] += (image, keypoint)
    return tracks


def _write_binary(
    folder: Path, points: np.ndarray, seen: list[np.ndarray], pixels: list[np.ndarray], tracks: list[list[int]]
) -> None:
    (folder / "cameras.bin").write_bytes(struct.pack("<QIiQQ4d", 1, 1, 1, *SIZE, 900, 900, 500, 400))
    with (folder / "images.bin").open("wb") as file:
        file.write(struct.pack("<Q", IMAGES))
        for image, (rows, places) in enumerate(zip(seen, pixels, strict=True), start=1):
            file.write(struct.pack("<I7dI", image, 1, 0, 0, 0, 0, 0, 5, 1) + f"{image}.png\0".encode())
            record = np.zeros(len(rows), dtype=[("pixel", "<f8", 2), ("point", "<u8")])
            record["pixel"], record["point"] = places, rows + 1
            file.write(struct.pack("<Q", len(rows)) + record.tobytes())
    with (folder / "points3D.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(points)))
        for row, (point, track) in enumerate(zip(points.tolist(), tracks, strict=True), start=1):
            file.write(struct.pack("<Q3d3BdQ", row, *point, 1, 2, 3, 0.5, len(track) // 2))
            file.write(struct.pack(f"<{len(track)}I", *track))


def _write_text(
    folder: Path, points: np.ndarray, seen: list[np.ndarray], pixels: list[np.ndarray], tracks: list[list[int]]
) -> None:
    (folder / "cameras.txt").write_text(f"1 PINHOLE {SIZE[0]} {SIZE[1]} 900 900 500 400\n", encoding="utf-8")
    with (folder / "images.txt").open("w", encoding="utf-8") as file:
        for image, (rows, places) in enumerate(zip(seen, pixels, strict=True), start=1):
            triples = " ".join(f"{x} {y} {row + 1}" for (x, y), row in zip(places.tolist(), rows.tolist(), strict=True))
            file.write(f"{image} 1 0 0 0 0 0 5 1 {image}.png\n{triples}\n")
    with (folder / "points3D.txt").open("w", encoding="utf-8") as file:
        for row, ((x, y, z), track) in enumerate(zip(points.tolist(), tracks, strict=True), start=1):
            file.write(f"{row} {x} {y} {z} 1 2 3 0.5 {' '.join(map(str, track))}\n")


def _write_opensfm(folder: Path, points: np.ndarray, seen: list[np.ndarray], pixels: list[np.ndarray]) -> None:
    camera = {"projection_type": "perspective", "width": SIZE[0], "height": SIZE[1], "focal": 0.9, "k1": 0, "k2": 0}
    pose = {"rotation": [0, 0, 0], "translation": [0, 0, 5], "camera": "c"}
    named = {str(row): {"color": [1, 2, 3], "coordinates": point} for row, point in enumerate(points.tolist(), start=1)}
    shots = {f"{image}.png": pose for image in range(1, IMAGES + 1)}
    document = [{"cameras": {"c": camera}, "shots": shots, "points": named}]
    (folder / "reconstruction.json").write_text(json.dumps(document), encoding="utf-8")
    with (folder / "tracks.csv").open("w", encoding="utf-8") as file:
        file.write("OPENSFM_TRACKS_VERSION_v2\n")
        for image, (rows, places) in enumerate(zip(seen, pixels, strict=True), start=1):
            normalised = ((places - np.array(SIZE) / 2) / max(SIZE)).round(6).tolist()
            file.writelines(
                f"{image}.png\t{row + 1}\t{number}\t{u}\t{v}\t0.004\t1\t2\t3\t-1\t-1\n"
                for number, (row, (u, v)) in enumerate(zip(rows.tolist(), normalised, strict=True))
            )


def main(argv: list[str]) -> int:
    """Print seconds and memory for each form, each in a process of its own."""
    if len(argv) == 2 and argv[0] == "--read":
        start, cpu = time.perf_counter(), time.process_time()
        scene = read_scene(argv[1])
        seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
        status = Path("/proc/self/status").read_text(encoding="ascii")  # getrusage tells the parent's peak after a fork
        peak = int(status.split("VmHWM:")[1].split()[0]) / 1e6
        observations = sum(len(view.keypoints) for view in scene.views)
        dense = "" if scene.dense is None else f", {len(scene.dense.points)} dense"
        print(f"{scene.format:<14} {seconds:6.2f} s ({cpu:.2f} s of processor)  {peak:5.2f} GB  ", end="")
        print(f"{len(scene.points)} points, {observations} observations{dense}")
        return 0
    with tempfile.TemporaryDirectory() as temporary:
        write_large_model(Path(temporary), int(argv[0]) if argv else 1_000_000)
        for form in FORMS:
            command = [sys.executable, "-m", "benchmarks.estimator.reading", "--read", str(Path(temporary) / form)]
            subprocess.run(command, check=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
