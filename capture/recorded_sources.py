"""Evidence in the recording of a scene: positions and inertial data of its video, or positions in EXIF data."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from metric_base.errors import InputError, Unquoted

if TYPE_CHECKING:
    from estimator.evidence.source import EvidenceSource
    from estimator.records.scene import Scene

#: Values of `gps` and `imu` that are not files.
NO_FILE = frozenset({"auto", "none"})
#: Suffixes of files with positions over time; other files of positions have one per image name.
TRACK_SUFFIXES = frozenset({".srt", ".mp4", ".mov", ".json"})


def recorded_sources(
    folder: Path, scene: Scene, gps: str = "auto", imu: str = "auto", images: Path | None = None
) -> tuple[EvidenceSource, ...]:
    """Return evidence from the recording of a scene: positions and inertial data of its video, or EXIF positions.

    Parameters
    ----------
    folder : Path
        Folder of the scene. The work folder of a capture names the video or the images that it was made from.
    scene : Scene
        The reconstruction in `folder`.
    gps, imu : str
        "auto" for the data in the recording itself, "none", or a log file.
    images : Path, optional
        Folder of the images, if it is not the one of the recording.

    Raises
    ------
    InputError
        A log cannot be read, or the scene has no video. Unreadable data in the video itself are ignored.
    """
    import numpy as np

    from capture.frame_poses import FILE_NAME, read_frame_poses
    from estimator.evidence.gps import Gps, VideoGps, images_have_gps
    from estimator.evidence.imu import Imu
    from estimator.evidence.source import CameraPath
    from estimator.telemetry.readers import read_telemetry
    from estimator.telemetry.records import Telemetry

    poses = read_frame_poses(folder) if (folder / FILE_NAME).is_file() else None
    if poses is None or not poses.source.is_file():  # images
        if is_track(gps) or imu not in NO_FILE:
            expected = "a video, or the work folder of one, as SCENE"
            raise InputError.at("arguments", "--imu, --gps", expected, Unquoted(str(folder)))
        images = images or (None if poses is None else poses.source)
        return (Gps("exif", images),) if gps == "auto" and images_have_gps(scene, images) else ()

    video, start_s = poses.source, poses.frames[0].time_s or 0.0
    known = [(pose.time_s, pose.centre) for pose in poses.frames if pose.time_s is not None and pose.centre is not None]
    times_s = np.array([time_s for time_s, _ in known]) - start_s
    path = CameraPath(times_s, np.array([centre for _, centre in known]).reshape(-1, 3))
    in_video = Telemetry()
    if "auto" in (gps, imu):
        with suppress(InputError):
            in_video = read_telemetry(video)

    def telemetry(value: str) -> Telemetry | None:
        if value == "auto":
            return in_video
        return None if value in {"none", "exif"} else read_telemetry(Path(value))

    sources: list[EvidenceSource] = []
    positions, motion = telemetry(gps), telemetry(imu)
    if positions is not None and positions.positions is not None:
        sources.append(VideoGps(positions.positions, path, video.name if gps == "auto" else Path(gps).name))
    if motion is not None and not (imu == "auto" and motion.is_inertially_empty):
        sources.append(Imu(motion, path, video.name if imu == "auto" else Path(imu).name))
    return tuple(sources)


def is_track(gps: str) -> bool:
    """Return whether `gps` is a file of positions over time."""
    return Path(gps).suffix.lower() in TRACK_SUFFIXES
