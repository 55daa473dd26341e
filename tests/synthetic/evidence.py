"""Files with evidence about the scale of a synthetic walk, right or wrong by a factor."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from estimator.evidence.camera_height import CameraHeight
from estimator.evidence.depth_maps import MetricDepth
from estimator.evidence.gps import Gps
from estimator.evidence.known_lengths import KnownLength, known_length_evidence
from estimator.evidence.markers import Marker
from estimator.evidence.rig_baseline import RigBaseline
from estimator.evidence.source import EvidenceSource
from estimator.projection.cameras import pixels_in_view
from estimator.records.objects import MeasuredObject, Measurements
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene
from metric_base.arrays import FloatArray
from metric_tree.tree import Tree
from tests.synthetic.walk import Walk

__all__ = [
    "DEPTH_WRITERS",
    "HEIGHT_M",
    "KINDS",
    "RIG_M",
    "Case",
    "degrees_of",
    "draw_marker",
    "marker_picture",
    "objects_of",
    "position_table",
    "write_depth_maps",
    "write_exif",
]

#: Height of the cameras over the floor, and baseline of the rig, in metres.
HEIGHT_M, RIG_M = 1.5, 0.12
#: Sides of the drawn markers, and of a board's squares and markers, in metres.
MARKER_M, SQUARE_M, BOARD_M = 0.8, 0.3, 0.22
#: Standard deviation of the log scale of a network that its user measured.
MEASURED_NETWORK_SD = 0.15
#: Supersampling factor of the drawn images.
SUPERSAMPLING = 3


@dataclass(frozen=True, slots=True)
class Case:
    """A kind of evidence. `of(walk, factor)` writes its files with all lengths multiplied by `factor`."""

    option: str
    of: Callable[[Walk, float], EvidenceSource | tuple[ScaleEvidence, ...]]

    def rows(self, walk: Walk, measurements: Measurements, factor: float = 1.0) -> tuple[ScaleEvidence, ...]:
        """Return the evidence about the walk."""
        evidence = self.of(walk, factor)
        return evidence if isinstance(evidence, tuple) else evidence.observe(walk.scene, measurements)


def objects_of(tree: Tree, names: Sequence[str], scale: float) -> list[MeasuredObject]:
    """Return objects with the median sizes of their priors and a sigma of 3 %, in units of `scale` metres."""
    sigma = np.full(3, 0.03)
    priors = [tree.find(name).prior(("length", "width", "height")) for name in names]
    sizes = [np.asarray(prior.quantile(0.5)) / 1000 / scale for prior in priors]
    return [
        MeasuredObject(str(row), name, size, sigma) for row, (name, size) in enumerate(zip(names, sizes, strict=True))
    ]


def degrees_of(metres: FloatArray, lat: float = 48.2, lon: float = 16.37) -> FloatArray:
    """Return latitude, longitude and altitude (n, 3) of positions (n, 3) in metres, on a spherical earth."""
    north = np.degrees(metres[:, 1] / 6371000.0)
    east = np.degrees(metres[:, 0] / 6371000.0 / math.cos(math.radians(lat)))
    return np.column_stack([lat + north, lon + east, 200 + metres[:, 2]])


def position_table(file: Path, scene: Scene, rows: FloatArray, columns: str) -> Path:
    """Write a CSV file with the name of each view and three numbers."""
    with file.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.writer(lines)
        writer.writerow(["name", *columns.split()])
        writer.writerows([view.name, *map(repr, map(float, row))] for view, row in zip(scene.views, rows, strict=True))
    return file


def write_exif(
    walk: Walk, factor: float = 1.0, seconds: int | None = None, place: tuple[float, float] = (-33.9, -70.6)
) -> None:
    """Write a small image of each view with its position in EXIF; by default, in the south-western hemisphere.

    seconds : time between the images in EXIF; by default, they have no time.
    """
    rows = degrees_of(factor * walk.metres, *place)
    for index, (view, (lat, lon, alt)) in enumerate(zip(walk.scene.views, rows, strict=True)):
        exif = Image.Exif()
        if seconds is not None:
            minutes, rest = divmod(index * seconds, 60)
            exif.get_ifd(0x8769)[0x9003] = f"2026:11:28 {minutes // 60:02}:{minutes % 60:02}:{rest:02}"
        hemispheres = {1: "S" if lat < 0 else "N", 3: "W" if lon < 0 else "E"}
        numbers = {2: _sexagesimal(abs(lat)), 4: _sexagesimal(abs(lon)), 6: float(alt)}
        exif[0x8825] = hemispheres | numbers | {5: b"\x00"}
        file = walk.scene.path / "images" / view.name
        file.parent.mkdir(parents=True, exist_ok=True)
        Image.new("L", (8, 6)).save(file, exif=exif)


def _sexagesimal(degrees: float) -> tuple[float, float, float]:
    minutes = (degrees - int(degrees)) * 60
    return float(int(degrees)), float(int(minutes)), round((minutes - int(minutes)) * 60, 5)


def draw_marker(walk: Walk, image: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], side: float) -> None:
    """Render an image for every view of a horizontal grey texture (h, w), `side` metres high, in the hall's centre."""
    height, width = image.shape
    ratio = width / height
    corners = np.array([[-ratio, 1, 0], [ratio, 1, 0], [ratio, -1, 0], [-ratio, -1, 0]]) * side / 2 + [0, 0, 0.9]
    edges = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32) - 0.5
    for view in walk.scene.views:
        pixels, _ = pixels_in_view(view, walk.units(corners))
        picture = np.full((SUPERSAMPLING * 480, SUPERSAMPLING * 640), 190, dtype=np.uint8)
        if np.isfinite(pixels).all():
            matrix = cv2.getPerspectiveTransform(edges, (SUPERSAMPLING * pixels - 0.5).astype(np.float32))
            size = picture.shape[1::-1]
            cv2.warpPerspective(image, matrix, size, picture, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
        picture = cv2.resize(picture, (640, 480), interpolation=cv2.INTER_AREA)
        file = walk.scene.path / "images" / view.name
        file.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(file), picture)


def _write_npy(file: Path, depth: FloatArray) -> None:
    np.save(file.with_suffix(".npy"), depth.astype(np.float32))


def _write_pfm(file: Path, depth: FloatArray) -> None:
    header = f"Pf\n{depth.shape[1]} {depth.shape[0]}\n-1.0\n".encode()
    file.with_suffix(".pfm").write_bytes(header + depth[::-1].astype("<f4").tobytes())


def _write_png(file: Path, depth: FloatArray) -> None:
    cv2.imwrite(str(file.with_suffix(".png")), np.round(depth * 1000).clip(0, 65535).astype(np.uint16))


DEPTH_WRITERS = {"npy": _write_npy, "pfm": _write_pfm, "png": _write_png}


def write_depth_maps(walk: Walk, folder: Path, form: str, factor: float = 1.0) -> Path:
    """Write depth maps in metres of the first five views, at half the resolution of the images."""
    folder.mkdir(exist_ok=True)
    for view in walk.scene.views[:5]:
        pixels, depths = pixels_in_view(view, walk.scene.points)
        depth = np.zeros((240, 320))
        inside = np.isfinite(pixels[:, 0])
        column, line = (pixels[inside] / 2).astype(int).T
        depth[line, column] = depths[inside] * walk.scale * factor
        DEPTH_WRITERS[form](folder / Path(view.name).name, depth)
    return folder


def _known_length(walk: Walk, factor: float) -> tuple[ScaleEvidence, ...]:
    a, b = walk.units(np.array([[0.0, 0, 0], [1.0, 2.0, 0.5]]))
    return known_length_evidence([KnownLength(a, b, factor * math.hypot(1, 2, 0.5))])


def _table(columns: str) -> Callable[[Walk, float], EvidenceSource]:
    def source(walk: Walk, factor: float) -> EvidenceSource:
        noisy = walk.metres + np.random.default_rng(1).normal(0, 0.02, walk.metres.shape)
        rows = factor * noisy if columns == "x y z" else degrees_of(factor * noisy)
        return Gps(position_table(walk.scene.path / "path.csv", walk.scene, rows, columns))

    return source


def _exif(walk: Walk, factor: float) -> EvidenceSource:
    write_exif(walk, factor)
    return Gps("exif")


def marker_picture(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return an image (520, 520) of marker 7 of a dictionary (400 pixels) with a white border."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name.removeprefix('DICT_')}"))
    quiet = np.full((520, 520), 255, dtype=np.uint8)
    quiet[60:460, 60:460] = cv2.aruco.generateImageMarker(dictionary, 7, 400)
    return quiet


def _marker(name: str) -> Callable[[Walk, float], EvidenceSource]:
    def source(walk: Walk, factor: float) -> EvidenceSource:
        draw_marker(walk, marker_picture(name), MARKER_M * 520 / 400)
        return Marker(name, factor * MARKER_M)

    return source


def _board(walk: Walk, factor: float) -> EvidenceSource:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((5, 5), SQUARE_M, BOARD_M, dictionary)
    draw_marker(walk, board.generateImage((500, 500)), 5 * SQUARE_M)
    return Marker.of(f"charuco:DICT_5X5_100:5x5:{factor * SQUARE_M}:{factor * BOARD_M}")


def _depth(form: str) -> Callable[[Walk, float], EvidenceSource]:
    def source(walk: Walk, factor: float) -> EvidenceSource:
        folder = write_depth_maps(walk, walk.scene.path / f"depth_{form}", form, factor)
        return MetricDepth(folder, network_sd=MEASURED_NETWORK_SD)

    return source


#: Every kind of evidence with a scale, by name.
KINDS = {
    "known length": Case("--known-length A B METRES", _known_length),
    "camera height": Case(
        "--camera-height 1.5+-0.15", lambda _, factor: CameraHeight(factor * HEIGHT_M, factor * 0.15)
    ),
    "GPS, EXIF": Case("--gps exif", _exif),
    "GPS, degrees": Case("--gps FILE (lat, lon, alt)", _table("lat lon alt")),
    "positions, metres": Case("--gps FILE (x, y, z)", _table("x y z")),
    "ArUco": Case("--marker DICT_4X4_50:0.8", _marker("DICT_4X4_50")),
    "AprilTag": Case("--marker APRILTAG_36h11:0.8", _marker("APRILTAG_36h11")),
    "ChArUco": Case("--marker charuco:DICT_5X5_100:5x5:0.3:0.22", _board),
    "depth, npy": Case("--metric-depth DIR (npy) --depth-error 0.15", _depth("npy")),
    "depth, PFM": Case("--metric-depth DIR (PFM) --depth-error 0.15", _depth("pfm")),
    "depth, PNG": Case("--metric-depth DIR (PNG, mm) --depth-error 0.15", _depth("png")),
    "baseline": Case("--baseline left:right:0.12", lambda _, factor: RigBaseline("left", "right", factor * RIG_M)),
}


def one(rows: tuple[ScaleEvidence, ...]) -> ScaleEvidence:
    """Return the only row."""
    (row,) = rows
    return row
