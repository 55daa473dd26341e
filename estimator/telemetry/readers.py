"""Google's Camera Motion Metadata (CAMM) of Android and 360 degree cameras.

https://developers.google.com/streetview/publish/camm-spec: a packet is two reserved bytes, its type in two, and little
endian numbers.

The telemetry of a video, or of a log beside it.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.telemetry.gpmf import Packet, gpmf_telemetry
from estimator.telemetry.records import Positions, Samples, Telemetry
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.input_files import read_json, read_text
from metric_base.parsing import csv_rows

#: Layout of the packets by type, after their first four bytes.
LAYOUTS = {0: "<3f", 1: "<2i", 2: "<3f", 3: "<3f", 4: "<3f", 5: "<3d", 6: "<di2d7f", 7: "<3f"}
GYROSCOPE, ACCELEROMETER, PLACE, FULL_PLACE = 2, 3, 5, 6
#: Least kind of fix of a full position: 2 is without altitude, 3 with it.
LEAST_FIX = 2
#: What FFmpeg may read: this file alone, as a container of pictures and sound, not as a list of other files.
READ_ALONE = {"protocol_whitelist": "file", "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg"}
#: Most bytes and packets of a metadata track, and most bytes of a log: hours of every sensor.
MAX_TRACK_BYTES, MAX_PACKETS, MAX_LOG_BYTES = 1 << 28, 1_000_000, 1 << 28
#: Packets of another kind that a track may begin with.
PROBED = 4
#: Columns of a log, in seconds on the clock of the video, m/s^2, rad/s, and metres or degrees.
TIME, FORCE, RATE = "time_s", ("ax", "ay", "az"), ("gx", "gy", "gz")
#: Time in a log of ARKit's or ARCore's poses, such as Stray Scanner's `odometry.csv`: seconds of a clock that ran
#: before; the first row is the first frame.
STAMP = "timestamp"
PLACES = {True: ("lat", "lon", "alt"), False: ("x", "y", "z")}
#: DJI's subtitles name positions as `[latitude: 1.0] [longitude: 2.0] ... abs_alt: 3.0`, or `GPS (2.0, 1.0, 3)`.
_CUE = re.compile(r"(\d{1,3}):(\d\d):(\d\d)[,.](\d{3})\s*-->")
_NUMBER = r"([-+]?\d{1,9}(?:\.\d{1,12})?)"
_NAMED = {
    name: re.compile(rf"\b{name}\s*[:=]\s*{_NUMBER}") for name in ("latitude", "longt?itude", "abs_alt", "altitude")
}
_PLAIN = re.compile(rf"GPS\s*\(\s*{_NUMBER}\s*,\s*{_NUMBER}\s*,\s*{_NUMBER}")


def is_camm(data: bytes) -> bool:
    """Whether bytes are a packet of this format."""
    if len(data) < 4:
        return False
    reserved, kind = struct.unpack_from("<HH", data)
    return reserved == 0 and kind in LAYOUTS and len(data) == 4 + struct.calcsize(LAYOUTS[kind])


def camm_telemetry(packets: Sequence[Packet]) -> Telemetry:
    """Accelerometer, gyroscope and positions of a CAMM track; packets of another form are left out."""
    rows: dict[int, list[tuple[float, ...]]] = {}
    for packet in packets:
        if is_camm(packet.data):
            kind = packet.data[2]
            rows.setdefault(kind, []).append((packet.time_s, *struct.unpack_from(LAYOUTS[kind], packet.data, 4)))
    return Telemetry(
        _camm_samples(rows.get(ACCELEROMETER, [])), _camm_samples(rows.get(GYROSCOPE, [])), _camm_positions(rows)
    )


def _camm_samples(rows: list[tuple[float, ...]]) -> Samples:
    table = np.array(sorted(rows), dtype=np.float64).reshape(-1, 4)
    table = table[np.isfinite(table).all(axis=1)]
    table = table[np.diff(table[:, 0], prepend=-np.inf) > 0]
    return Samples(table[:, 0], table[:, 1:])


def _camm_positions(rows: dict[int, list[tuple[float, ...]]]) -> Positions | None:
    full = [row for row in rows.get(FULL_PLACE, []) if row[2] >= LEAST_FIX]
    accuracy = float(np.median([row[6] for row in full])) if full else None
    plain = [(row[0], row[3], row[4], row[5]) for row in full] or rows.get(PLACE, [])
    samples = _camm_samples([(row[0], row[1], row[2], row[3]) for row in plain])
    if not len(samples):
        return None
    known = accuracy is not None and np.isfinite(accuracy) and accuracy > 0
    return Positions(samples.times_s, samples.values, geodetic=True, accuracy_m=accuracy if known else None)


def read_telemetry(file: Path) -> Telemetry:
    """The telemetry of a video, a CSV log, Record3D's `metadata.json`, or the subtitles of a drone.

    Raises
    ------
    InputError
        The file is missing, or is a log whose columns or numbers are wrong.
    """
    if not file.is_file():
        raise InputError.at(file, "file", "a video or a log", Unquoted("no such file"))
    if file.suffix.lower() == ".csv":
        return _csv_telemetry(file)
    if file.suffix.lower() == ".json":
        return _record3d_telemetry(file)
    if file.suffix.lower() == ".srt":
        return Telemetry(positions=subtitle_positions(read_text(file, MAX_LOG_BYTES)))
    return video_telemetry(file)


def video_telemetry(file: Path) -> Telemetry:
    """What the metadata tracks of a video hold, GPMF or CAMM, or subtitles of the same name beside it."""
    for packets in _metadata_tracks(file):
        if packets[0].data[:4] == b"DEVC":
            return gpmf_telemetry(packets)
        if any(is_camm(packet.data) for packet in packets[:PROBED]):
            return camm_telemetry(packets)
    beside = next((file.with_suffix(end) for end in (".srt", ".SRT") if file.with_suffix(end).is_file()), None)
    if beside is None:
        return Telemetry()
    return Telemetry(positions=subtitle_positions(read_text(beside, MAX_LOG_BYTES)))


def subtitle_positions(text: str) -> Positions | None:
    r"""Positions by the cues of a drone's subtitles; cues without one, or before any satellite, are left out.

    >>> subtitle_positions("00:00:01,500 --> 00:00:02,000\n[latitude: 1.5] [longitude: 2.0] abs_alt: 30.0").places
    array([[ 1.5,  2. , 30. ]])
    """
    rows = []
    cues = list(_CUE.finditer(text))
    ends = [cue.start() for cue in cues[1:]] + [len(text)]
    for cue, end in zip(cues, ends, strict=False):
        place = _subtitle_place(text[cue.end() : end])
        if place is not None and (place[0] or place[1]):
            hours, minutes, seconds, thousandths = (int(part) for part in cue.groups())
            rows.append((3600 * hours + 60 * minutes + seconds + thousandths / 1000, *place))
    return _positions(np.array(rows, dtype=np.float64).reshape(-1, 4), geodetic=True)


def _subtitle_place(text: str) -> tuple[float, float, float] | None:
    plain = _PLAIN.search(text)
    if plain:
        east, north, up = (float(part) for part in plain.groups())
        return north, east, up
    matches = {name: pattern.search(text) for name, pattern in _NAMED.items()}
    latitude, longitude, absolute, altitude = (match and float(match[1]) for match in matches.values())
    height = absolute if absolute is not None else altitude
    if latitude is None or longitude is None:
        return None
    return latitude, longitude, height or 0.0


def _metadata_tracks(file: Path) -> Iterable[list[Packet]]:
    """The packets of each metadata track that has any."""
    try:
        import av
    except ImportError:
        return
    try:
        with av.open(f"file:{file}", metadata_errors="replace", container_options=READ_ALONE) as container:
            numbers = [stream.index for stream in container.streams if stream.type == "data"]
            tracks: dict[int, list[Packet]] = {number: [] for number in numbers}
            left, many = MAX_TRACK_BYTES, MAX_PACKETS
            for packet in container.demux([container.streams[number] for number in numbers]) if numbers else ():
                if packet.pts is None or not packet.size or packet.time_base is None:
                    continue
                left, many = left - packet.size, many - 1
                if left < 0 or many < 0:
                    break
                unit = float(packet.time_base)
                row = Packet(packet.pts * unit, (packet.duration or 0) * unit, bytes(packet))
                tracks[packet.stream_index].append(row)
    except (av.error.FFmpegError, OSError):
        return
    yield from (packets for packets in tracks.values() if packets)


def _csv_telemetry(file: Path) -> Telemetry:
    """Columns `time_s` and `ax, ay, az`, `gx, gy, gz`, `lat, lon, alt` or `x, y, z`; empty cells are left out.

    `timestamp` in place of `time_s` counts from the first row.
    """
    fields, records = csv_rows(file)
    names = {field.strip().lower() for field in fields}
    kinds = [kind for kind in (FORCE, RATE, *PLACES.values()) if set(kind) <= names]
    clock = next((name for name in (TIME, STAMP) if name in names), None)
    if clock is None or not kinds:
        expected = f"columns {TIME} (or {STAMP}) and ax, ay, az, gx, gy, gz, or lat, lon, alt, or x, y, z"
        raise InputError.at(file, "header", expected, Unquoted(", ".join(sorted(names)) or "none"))
    rows: dict[tuple[str, ...], list[list[float]]] = {kind: [] for kind in kinds}
    for number, record in records:
        # what is too much in a row is under the key None
        cells = {key.strip().lower(): (value or "").strip() for key, value in record.items() if key is not None}
        for kind in kinds:
            if any(cells[column] for column in kind):
                with in_file(file), at_field(f"line {number}"):
                    rows[kind].append(_numbers([cells[clock], *(cells[column] for column in kind)]))
    tables = {kind: np.array(sorted(values), dtype=np.float64).reshape(-1, 4) for kind, values in rows.items()}
    if clock == STAMP:
        first = min((table[0, 0] for table in tables.values() if len(table)), default=0.0)
        tables = {kind: table - [first, 0.0, 0.0, 0.0] for kind, table in tables.items()}
    empty = np.empty((0, 4))
    return Telemetry(
        _samples(tables.get(FORCE, empty)),
        _samples(tables.get(RATE, empty)),
        _positions(tables.get(PLACES[True], empty), geodetic=True),
        _positions(tables.get(PLACES[False], empty), geodetic=False),
    )


def _numbers(cells: list[str]) -> list[float]:
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        raise FieldError("", "numbers", cells) from None
    if not np.isfinite(numbers).all():
        raise FieldError("", "finite numbers", cells)
    return numbers


def _record3d_telemetry(file: Path) -> Telemetry:
    """Record3D's `metadata.json`: `poses`, rows of a quaternion and a place in metres, and `fps`."""
    with in_file(file):
        document: Any = read_json(file)
    poses = document.get("poses") if isinstance(document, dict) else None
    rate = document.get("fps") if isinstance(document, dict) else None
    try:
        table = np.array(poses, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        table = np.empty(0)
    if table.ndim != 2 or table.shape[1] != 7 or not np.isfinite(table).all():
        words = Unquoted(json.dumps(poses)[:40])
        raise InputError.at(file, "poses", "rows of seven finite numbers (Record3D's metadata.json)", words)
    if not isinstance(rate, int | float) or isinstance(rate, bool) or not 0 < rate < 1e4:
        raise InputError.at(file, "fps", "frames a second", rate)
    return Telemetry(path=Positions(np.arange(len(table)) / float(rate), table[:, 4:], geodetic=False))


def _samples(table: FloatArray) -> Samples:
    """Rows (n, 4) of a time and three values, without times that do not grow."""
    table = table[np.diff(table[:, 0], prepend=-np.inf) > 0]
    return Samples(table[:, 0], table[:, 1:])


def _positions(table: FloatArray, geodetic: bool) -> Positions | None:
    """Rows (n, 4) of a time and a place; None of no rows."""
    samples = _samples(table)
    return Positions(samples.times_s, samples.values, geodetic) if len(samples) else None
