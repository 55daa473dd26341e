"""The options of `estimate-scale` that ask for evidence, and the sources that they name."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from metric_base.errors import InputError, Unquoted

if TYPE_CHECKING:
    from estimator.evidence.source import EvidenceSource

__all__ = ["add_evidence_options", "evidence_sources", "up_direction"]


def add_evidence_options(parser: argparse.ArgumentParser) -> None:
    """Add the options; nothing heavy is imported."""
    group = parser.add_argument_group("evidence beside the objects (of a SCENE)")
    add = group.add_argument
    height = "metres of the camera above the floor, as 1.5+-0.15, or handheld, tripod, car"
    add("--camera-height", metavar="HEIGHT", help=height)
    add("--gps", metavar="exif|FILE", help="camera positions in the pictures, or CSV: name, lat, lon, alt or x, y, z")
    marker = "ArUco or AprilTag markers with a side of METRES, as DICT_4X4_50:0.1; charuco:DICT:COLSxROWS:SQUARE:MARKER"
    add("--marker", metavar="DICT:METRES", action="append", default=[], help=marker)
    depth = "depth maps of a network in metres, named as the pictures (npy, PFM, 16-bit PNG in mm)"
    add("--metric-depth", metavar="DIR", type=Path, help=depth)
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
    values = [options.camera_height, options.gps, options.metric_depth, *options.marker, *options.baseline]
    if all(value is None for value in values):
        return ()
    if options.objects is not None or options.method in {"paper", "sucar"}:
        obstacle = "--objects" if options.objects is not None else f"--method {options.method}"
        expected = "a SCENE and --method default or height"
        names = "--camera-height, --gps, --marker, --metric-depth, --baseline"
        raise InputError.at(names, "evidence", expected, Unquoted(obstacle))
    if options.gps not in {None, "exif"} and not Path(options.gps).is_file():
        raise InputError(f"--gps: expected exif, or a CSV file; found no file {options.gps}")
    if options.metric_depth is not None and not options.metric_depth.is_dir():
        raise InputError(f"--metric-depth: expected a folder of depth maps; found no folder {options.metric_depth}")
    from estimator.evidence.camera_height import CameraHeight
    from estimator.evidence.gps import Gps
    from estimator.evidence.marker import Marker
    from estimator.evidence.metric_depth import MetricDepth

    sources: list[EvidenceSource] = []
    if options.camera_height is not None:
        sources.append(CameraHeight.of(options.camera_height))
    if options.gps is not None:
        sources.append(Gps("exif" if options.gps == "exif" else Path(options.gps), options.images))
    sources += [replace(Marker.of(text), images=options.images) for text in options.marker]
    if options.metric_depth is not None:
        sources.append(MetricDepth(options.metric_depth))
    return (*sources, *(source for text in options.baseline for source in _baselines(text)))


def _baselines(text: str) -> tuple[EvidenceSource, ...]:
    from estimator.evidence.lengths import RigBaseline, rig_baselines

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
