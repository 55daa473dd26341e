"""Read the sensor data of a video, or of a log next to it.

Videos contain GPMF (GoPro, `gpmf`) or Google's Camera Motion Metadata (CAMM, of Android and 360 degree cameras:
https://developers.google.com/streetview/publish/camm-spec). A CAMM packet is two reserved bytes, its type in two, and
little endian numbers. Logs are CSV files, `metadata.json` of Record3D, and the subtitles of DJI drones.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.telemetry.gpmf import MIN_FIX, Packet, gpmf_telemetry
from estimator.telemetry.records import Positions, Samples, Telemetry
from metric_base.errors import InputError, Unquoted, at_field, expect, in_file
from metric_base.input_files import read_json, read_text
from metric_base.parsing import csv_rows, finite_numbers, json_array, json_object, matrix_of, number_of

#: Layout of a CAMM packet by its type, after the first four bytes.
_CAMM_LAYOUTS = {0: "<3f", 1: "<2i", 2: "<3f", 3: "<3f", 4: "<3f", 5: "<3d", 6: "<di2d7f", 7: "<3f"}
_GYROSCOPE, _ACCELEROMETER, _POSITION, _FULL_POSITION = 2, 3, 5, 6
#: Options of FFmpeg that restrict it to this file, as a container of images and sound, without lists of other files.
READ_ALONE = {"protocol_whitelist": "file", "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg"}
#: Maximum size of the metadata tracks of a video in bytes: hours of all sensors.
MAX_TRACK_BYTES = 1 << 28
#: Maximum number of packets of the metadata tracks of a video.
MAX_PACKETS = 1_000_000
#: Maximum size of a log in bytes.
MAX_LOG_BYTES = 1 << 28
#: Exclusive maximum of the frames per second of a log.
MAX_FRAME_RATE = 1e4
#: Number of packets at the start of a track that are searched for one of CAMM.
N_PROBED_PACKETS = 4
#: Columns of a log: seconds in the time of the video, m/s^2 and rad/s.
TIME, SPECIFIC_FORCE, ANGULAR_RATE = "time_s", ("ax", "ay", "az"), ("gx", "gy", "gz")
#: Time column of logs of ARKit's or ARCore's poses, such as `odometry.csv` of Stray Scanner: seconds of another clock;
#: the first row belongs to the first frame.
STAMP = "timestamp"
#: Columns of positions: geodetic (degrees, metres), and in metres.
POSITION_COLUMNS = {True: ("lat", "lon", "alt"), False: ("x", "y", "z")}
#: Subtitles of DJI contain `[latitude: 1.0] [longitude: 2.0] ... abs_alt: 3.0`, or `GPS (2.0, 1.0, 3)`.
_CUE = re.compile(r"(\d{1,3}):(\d\d):(\d\d)[,.](\d{3})\s*-->")
_NUMBER = r"([-+]?\d{1,9}(?:\.\d{1,12})?)"
_NAMED = {
    name: re.compile(rf"\b{name}\s*[:=]\s*{_NUMBER}") for name in ("latitude", "longt?itude", "abs_alt", "altitude")
}
_PLAIN = re.compile(rf"GPS\s*\(\s*{_NUMBER}\s*,\s*{_NUMBER}\s*,\s*{_NUMBER}")


def read_telemetry(file: Path) -> Telemetry:
    """Read the sensor data of a video, a CSV log, `metadata.json` of Record3D, or the subtitles of a drone.

    Raises
    ------
    InputError
        The file is missing, or is a log with invalid columns or numbers.
    """
    if not file.is_file():
        raise InputError.at(file, "file", "a video or a log", Unquoted("no such file"))
    suffix = file.suffix.lower()
    if suffix == ".csv":
        return _csv_telemetry(file)
    if suffix == ".json":
        return _record3d_telemetry(file)
    subtitles: Path | None = file
    if suffix != ".srt":
        for packets in _metadata_tracks(file):
            if packets[0].data[:4] == b"DEVC":
                return gpmf_telemetry(packets)
            if any(is_camm(packet.data) for packet in packets[:N_PROBED_PACKETS]):
                return camm_telemetry(packets)
        # A drone writes the subtitles of a video to a file with its name.
        subtitles = next((path for end in (".srt", ".SRT") if (path := file.with_suffix(end)).is_file()), None)
    if subtitles is None:
        return Telemetry()
    return Telemetry(positions=subtitle_positions(read_text(subtitles, MAX_LOG_BYTES)))


def is_camm(data: bytes) -> bool:
    """Return True if the bytes are a packet of CAMM."""
    if len(data) < 4:
        return False
    reserved, kind = struct.unpack_from("<HH", data)
    return reserved == 0 and kind in _CAMM_LAYOUTS and len(data) == 4 + struct.calcsize(_CAMM_LAYOUTS[kind])


def camm_telemetry(packets: Sequence[Packet]) -> Telemetry:
    """Read accelerometer, gyroscope and positions of a CAMM track; other packets are ignored."""
    rows: dict[int, list[tuple[float, ...]]] = {}
    for packet in packets:
        if is_camm(packet.data):
            kind = packet.data[2]
            rows.setdefault(kind, []).append((packet.time_s, *struct.unpack_from(_CAMM_LAYOUTS[kind], packet.data, 4)))

    def finite_rows(rows: Sequence[tuple[float, ...]]) -> Any:
        """Return the rows (n, 4) with finite values, sorted by time."""
        table = np.array(sorted(rows), dtype=np.float64).reshape(-1, 4)
        return table[np.isfinite(table).all(axis=1)]

    # time, fix time, fix type, latitude, longitude, altitude, horizontal accuracy, ...
    full = [row for row in rows.get(_FULL_POSITION, []) if row[2] >= MIN_FIX]
    accuracy_m = float(np.median([row[6] for row in full])) if full else float("nan")
    is_known = bool(np.isfinite(accuracy_m)) and accuracy_m > 0
    fixes = [(row[0], *row[3:6]) for row in full] or [row[:4] for row in rows.get(_POSITION, [])]
    return Telemetry(
        Samples.from_rows(finite_rows(rows.get(_ACCELEROMETER, []))),
        Samples.from_rows(finite_rows(rows.get(_GYROSCOPE, []))),
        Positions.from_rows(finite_rows(fixes), geodetic=True, accuracy_m=accuracy_m if is_known else None),
    )


def subtitle_positions(text: str) -> Positions | None:
    r"""Read the positions of a drone's subtitles; subtitles without a position, or at 0, 0, are ignored.

    >>> subtitle_positions("00:00:01,500 --> 00:00:02,000\n[latitude: 1.5] [longitude: 2.0] abs_alt: 30.0").positions
    array([[ 1.5,  2. , 30. ]])
    """
    rows = []
    cues = list(_CUE.finditer(text))
    ends = [cue.start() for cue in cues[1:]] + [len(text)]
    for cue, end in zip(cues, ends, strict=False):
        caption = text[cue.end() : end]
        if plain := _PLAIN.search(caption):
            longitude, latitude, altitude = (float(part) for part in plain.groups())
        else:
            matches = [pattern.search(caption) for pattern in _NAMED.values()]
            named_latitude, named_longitude, absolute, relative = (match and float(match[1]) for match in matches)
            if named_latitude is None or named_longitude is None:
                continue
            latitude, longitude = named_latitude, named_longitude
            altitude = (absolute if absolute is not None else relative) or 0.0  # 0 if it is missing
        if latitude or longitude:
            hours, minutes, seconds, thousandths = (int(part) for part in cue.groups())
            time_s = 3600 * hours + 60 * minutes + seconds + thousandths / 1000
            rows.append((time_s, latitude, longitude, altitude))
    return Positions.from_rows(np.array(rows, dtype=np.float64).reshape(-1, 4), geodetic=True)


def _metadata_tracks(file: Path) -> Iterator[list[Packet]]:
    """Yield the packets of each metadata track of a video that has any."""
    try:
        import av
    except ImportError:
        return
    try:
        with av.open(f"file:{file}", metadata_errors="replace", container_options=READ_ALONE) as container:
            streams = [stream for stream in container.streams if stream.type == "data"]
            tracks: dict[int, list[Packet]] = {stream.index: [] for stream in streams}
            n_bytes = n_packets = 0
            for packet in container.demux(streams) if streams else ():
                if packet.pts is None or not packet.size or packet.time_base is None:
                    continue
                n_bytes, n_packets = n_bytes + packet.size, n_packets + 1
                if n_bytes > MAX_TRACK_BYTES or n_packets > MAX_PACKETS:
                    break
                unit = float(packet.time_base)
                read = Packet(packet.pts * unit, (packet.duration or 0) * unit, bytes(packet))
                tracks[packet.stream_index].append(read)
    except (av.error.FFmpegError, OSError):
        return
    yield from (packets for packets in tracks.values() if packets)


def _csv_telemetry(file: Path) -> Telemetry:
    """Read a log with the columns `time_s` and `ax, ay, az`, `gx, gy, gz`, `lat, lon, alt` or `x, y, z`.

    Empty cells are ignored. `timestamp` instead of `time_s` counts from the first row.
    """
    fields, records = csv_rows(file)
    names = {field.strip().lower() for field in fields}
    kinds = [kind for kind in (SPECIFIC_FORCE, ANGULAR_RATE, *POSITION_COLUMNS.values()) if set(kind) <= names]
    clock = next((name for name in (TIME, STAMP) if name in names), None)
    if clock is None or not kinds:
        expected = f"columns {TIME} (or {STAMP}) and ax, ay, az, gx, gy, gz, or lat, lon, alt, or x, y, z"
        raise InputError.at(file, "header", expected, Unquoted(", ".join(sorted(names)) or "none"))
    rows: dict[tuple[str, ...], list[list[float]]] = {kind: [] for kind in kinds}
    for line, record in records:
        # The csv module stores surplus cells of a row under the key None.
        cells = {key.strip().lower(): (value or "").strip() for key, value in record.items() if key is not None}
        for kind in kinds:
            if any(cells[column] for column in kind):
                with in_file(file), at_field(f"line {line}"):
                    rows[kind].append(finite_numbers([cells[clock], *(cells[column] for column in kind)]))
    tables = {kind: np.array(sorted(values), dtype=np.float64).reshape(-1, 4) for kind, values in rows.items()}
    if clock == STAMP:
        first = min((table[0, 0] for table in tables.values() if len(table)), default=0.0)
        tables = {kind: table - [first, 0.0, 0.0, 0.0] for kind, table in tables.items()}
    empty = np.empty((0, 4))
    return Telemetry(
        Samples.from_rows(tables.get(SPECIFIC_FORCE, empty)),
        Samples.from_rows(tables.get(ANGULAR_RATE, empty)),
        Positions.from_rows(tables.get(POSITION_COLUMNS[True], empty), geodetic=True),
        Positions.from_rows(tables.get(POSITION_COLUMNS[False], empty), geodetic=False),
    )


def _record3d_telemetry(file: Path) -> Telemetry:
    """Read `metadata.json` of Record3D: `poses`, rows of a quaternion and a position in metres, and `fps`."""
    with in_file(file):
        document = json_object(read_json(file))
        poses, rate = json_array(document.get("poses"), "poses of Record3D"), number_of(document, "fps")
        table = matrix_of(poses, (len(poses), 7), "poses")
        expect(0 < rate < MAX_FRAME_RATE, "fps", "frames per second", rate)
    return Telemetry(path=Positions(np.arange(len(table)) / rate, table[:, 4:], geodetic=False))
