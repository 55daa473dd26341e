"""The options of `estimate-scale` that ask for evidence, and the sources that they name."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from metric_base.errors import InputError, Unquoted
from metric_cli.arguments import input_path

if TYPE_CHECKING:
    from estimator.evidence.camera_path import CameraPath
    from estimator.evidence.source import EvidenceSource
    from estimator.records.scene import Scene
    from estimator.telemetry.records import Telemetry

__all__ = [
    "add_evidence_options",
    "asks_for_evidence",
    "automatic_sources",
    "evidence_sources",
    "has_evidence",
    "up_direction",
]

#: Values of `--gps` and `--imu` that name no file.
AUTOMATIC = frozenset({"auto", "none"})
#: Files of positions over time.
TIMED = frozenset({".srt", ".mp4", ".mov", ".json"})


#: What `--depth-unit` takes, and the metres of one step of a PNG where it says them.
DEPTH_UNITS = ("metres", "1/256", "da3", "metric3d")
PNG_METRES = {"1/256": 1 / 256, "da3": 1.0, "metric3d": 1.0}


def add_evidence_options(parser: argparse.ArgumentParser) -> None:
    """Add the options; nothing heavy is imported."""
    group = parser.add_argument_group("evidence beside the objects (of a SCENE)")
    add = group.add_argument
    height = "metres of the camera above the floor, as 1.5+-0.15, or handheld, tripod, car"
    add("--camera-height", metavar="HEIGHT", help=height)
    gps = (
        "camera positions: CSV (name, lat, lon, alt or x, y, z), EXIF, or auto: of the video or EXIF, if there are any"
    )
    add("--gps", metavar="auto|exif|none|FILE", default="auto", help=f"{gps} (default: %(default)s)")
    imu = "accelerometer and gyroscope of a video: its own (GPMF, CAMM), or a log (CSV, Record3D)"
    add("--imu", metavar="auto|none|FILE", default="auto", help=f"{imu} (default: %(default)s)")
    marker = "ArUco or AprilTag markers with a side of METRES, as DICT_4X4_50:0.1; charuco:DICT:COLSxROWS:SQUARE:MARKER"
    add("--marker", metavar="DICT:METRES", action="append", default=[], help=marker)
    depth = "depth maps of a network, named as the pictures (NPY, NPZ, EXR, PFM, 16-bit PNG)"
    add("--metric-depth", metavar="DIR", type=input_path, help=depth)
    unit = "PNG in mm (metres: all else in metres) or 1/256 m; da3: focal * value / 300; metric3d: focal * value / 1000"
    add("--depth-unit", choices=DEPTH_UNITS, default="metres", help=unit)
    doubt = "what the network's metres are worth, one standard deviation as a share (default: %(default)s)"
    add("--depth-error", metavar="SHARE", type=float, default=0.15, help=doubt)
    baseline = "two cameras of a rig by their folders and distance, as left:right:0.12; or COLMAP's rig_config.json"
    add("--baseline", metavar="A:B:METRES|FILE", action="append", default=[], help=baseline)

    add(
        "--up",
        metavar="X,Y,Z",
        help="up in the scene's axes, as measured by an inertial unit (not gravity, which points down)",
    )


def up_direction(options: argparse.Namespace) -> tuple[float, float, float] | None:
    """The direction of `--up`; None without it.

    Raises
    ------
    InputError
        It is no direction, or there is no scene to look at.
    """
    if options.up is None:
        return None
    if options.objects is not None:
        raise InputError("--up: expected a SCENE; found --objects")
    from estimator.geometry.up import given_up

    try:
        x, y, z = (float(part) for part in options.up.split(","))
        given_up((x, y, z))
    except ValueError:
        raise InputError.at("--up", "direction", "X,Y,Z, three finite numbers, not all 0", options.up) from None
    return x, y, z


def evidence_sources(options: argparse.Namespace) -> tuple[EvidenceSource, ...]:
    """The sources that the options name.

    Raises
    ------
    InputError
        A value cannot be read, or there is no scene to look at.
    """
    _check_automatic(options)
    if not _names_source(options):
        return ()
    if options.objects is not None or options.method in {"paper", "sucar"}:
        obstacle = "--objects" if options.objects is not None else f"--method {options.method}"
        expected = "a SCENE and --method default or height"
        names = "--camera-height, --gps, --imu, --marker, --metric-depth, --baseline"
        raise InputError.at(names, "evidence", expected, Unquoted(obstacle))
    if options.metric_depth is not None and not options.metric_depth.is_dir():
        raise InputError(f"--metric-depth: expected a folder of depth maps; found no folder {options.metric_depth}")
    from estimator.evidence.camera_height import CameraHeight
    from estimator.evidence.gps import Gps
    from estimator.evidence.marker import Marker

    sources: list[EvidenceSource] = []
    if options.camera_height is not None:
        sources.append(CameraHeight.of(options.camera_height))
    if options.gps not in AUTOMATIC and not _is_log(options.gps):
        sources.append(Gps("exif" if options.gps == "exif" else Path(options.gps), options.images))
    sources += [replace(Marker.of(text), images=options.images) for text in options.marker]
    if options.metric_depth is not None:
        sources.append(_metric_depth(options))
    return (*sources, *(source for text in options.baseline for source in _baselines(text)))


def _metric_depth(options: argparse.Namespace) -> EvidenceSource:
    from estimator.evidence.metric_depth import FOCAL_UNITS, MetricDepth

    if not 0 < options.depth_error <= 1:
        raise InputError.at("--depth-error", "value", "a share above 0 and up to 1", options.depth_error)
    unit = options.depth_unit if options.depth_unit in FOCAL_UNITS else "metres"
    metres = PNG_METRES.get(options.depth_unit, 0.001)
    return MetricDepth(options.metric_depth, png_metres=metres, unit=unit, network_sd=options.depth_error)


def automatic_sources(options: argparse.Namespace, scene: Scene) -> tuple[EvidenceSource, ...]:
    """What the video or the pictures of a scene bring themselves: an inertial unit, and positions.

    Raises
    ------
    InputError
        A log that the user named cannot be read.
    """
    if options.method in {"paper", "sucar"}:
        return ()
    from estimator.evidence.gps import Gps, VideoGps, pictures_have_gps
    from estimator.evidence.imu import Imu

    recording = _recording(options.scene)
    pictures = options.images or (None if recording is None else recording[0])
    video = recording is not None and recording[0].is_file()
    sources: list[EvidenceSource] = []
    if recording is not None and video:
        file, path = recording
        own = _own_telemetry(file) if "auto" in (options.gps, options.imu) else None
        gps = own if options.gps == "auto" else _log(options.gps)
        imu = own if options.imu == "auto" else _log(options.imu)
        if gps is not None and gps.positions is not None:
            sources.append(VideoGps(gps.positions, path, file.name if gps is own else Path(options.gps).name))
        if imu is not None and not (imu is own and imu.is_inertially_empty):
            sources.append(Imu(imu, path, file.name if imu is own else Path(options.imu).name))
    elif _is_log(options.gps) or options.imu not in AUTOMATIC:
        expected = "a video, or the work folder of one, as SCENE"
        raise InputError.at("arguments", "--imu, --gps", expected, Unquoted(str(options.scene)))
    if not video and options.gps == "auto" and pictures_have_gps(scene, pictures):
        sources.append(Gps("exif", pictures))
    return tuple(sources)


def has_evidence(options: argparse.Namespace, work: Path) -> bool:
    """Whether a video or pictures that were reconstructed in a work folder have a scale without masks."""
    from estimator.scene_reading import read_scene

    scene = read_scene(work, "none")
    return bool(automatic_sources(argparse.Namespace(**(vars(options) | {"scene": work})), scene))


def asks_for_evidence(options: argparse.Namespace) -> bool:
    """Whether the user asks for evidence, rather than leaves it to what the files bring."""
    return _names_source(options) or bool(options.known_length)


def _names_source(options: argparse.Namespace) -> bool:
    values = [options.camera_height, options.metric_depth, *options.marker, *options.baseline]
    named = options.gps not in AUTOMATIC or options.imu not in AUTOMATIC
    return named or any(value is not None for value in values)


def _check_automatic(options: argparse.Namespace) -> None:
    """InputError for a file of `--gps` or `--imu` that is missing."""
    if options.gps not in {*AUTOMATIC, "exif"} and not Path(options.gps).is_file():
        raise InputError(f"--gps: expected auto, exif, none, or a file; found no file {options.gps}")
    if options.imu not in AUTOMATIC and not Path(options.imu).is_file():
        raise InputError(f"--imu: expected auto, none, or a file; found no file {options.imu}")


def _is_log(value: str) -> bool:
    """Whether `--gps` names positions over time rather than by the names of pictures."""
    return Path(value).suffix.lower() in TIMED


def _log(value: str) -> Telemetry | None:
    """The telemetry of a file that an option names, None where it names none or a table by pictures."""
    from estimator.telemetry.recordings import read_telemetry

    if value in AUTOMATIC or (value == "exif"):
        return None
    return read_telemetry(Path(value))


def _own_telemetry(file: Path) -> Telemetry:
    """What a video holds itself; nothing where that cannot be read."""
    from estimator.telemetry.recordings import read_telemetry
    from estimator.telemetry.records import Telemetry

    try:
        return read_telemetry(file)
    except InputError:
        return Telemetry()


def _recording(scene: Path) -> tuple[Path, CameraPath] | None:
    """The video or folder of pictures that a work folder is of, and the path of its camera."""
    import numpy as np

    from estimator.capture.frame_poses import FILE_NAME, read_frame_poses
    from estimator.evidence.camera_path import CameraPath

    if not (scene / FILE_NAME).is_file():
        return None
    poses = read_frame_poses(scene)
    rows = [(pose.time_s, pose.centre) for pose in poses.frames if pose.time_s is not None and pose.centre is not None]
    times, centres = np.array([time for time, _ in rows]), np.array([centre for _, centre in rows]).reshape(-1, 3)
    return poses.source, CameraPath(times - (poses.frames[0].time_s or 0.0), centres)


def _baselines(text: str) -> tuple[EvidenceSource, ...]:
    from estimator.evidence.rig_baseline import RigBaseline, rig_baselines

    if text.endswith(".json"):
        return rig_baselines(Path(text))
    try:
        first, second, metres = text.split(":")
        length = float(metres)
    except ValueError:
        length = 0.0
    if not 0 < length < float("inf"):
        expected = "A:B:METRES, two folders of pictures and their distance, or COLMAP's rig_config.json"
        raise InputError.at("--baseline", "value", expected, text)
    return (RigBaseline(first, second, length),)
