"""Read the metadata format of GoPro (GPMF; https://gopro.github.io/gpmf-parser/).

A stream is a sequence of keys: four characters, a type, the size of a value, the number of values, and the values, big
endian and padded to four bytes. Type 0 contains keys. A sensor is a key `STRM` that contains its samples, after the
keys that apply to them: `SCAL` divides the values, `ORIN` names the axes, `STMP` is the time of the first sample in
microseconds.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.telemetry.records import Positions, Samples, Telemetry
from metric_base.arrays import FloatArray

#: Maximum depth of nested keys.
MAX_DEPTH = 8
#: Maximum number of keys of a sensor in one packet.
MAX_KEYS = 100_000
#: NumPy types of the numeric types of GPMF.
_DTYPES = {b"b": ">i1", b"B": ">u1", b"s": ">i2", b"S": ">u2", b"l": ">i4", b"L": ">u4", b"j": ">i8", b"J": ">u8"}
_DTYPES |= {b"f": ">f4", b"d": ">f8", b"q": ">i4", b"Q": ">i8"}
#: Divisors of fixed-point types.
_FIXED_POINT = {b"q": 2.0**16, b"Q": 2.0**32}
#: Minimum type of a satellite fix: 2 is a position without altitude, 3 with altitude.
MIN_FIX = 2
#: Standard deviation of a position in metres per unit of dilution of precision, for consumer receivers.
METRES_PER_DILUTION = 2.5
#: Maximum duration of a packet in seconds; samples are not distributed over a longer gap.
MAX_PACKET_S = 10.0
#: Sensors that are read. Positions come from the first of the last three that is present.
_INERTIAL, _RECEIVERS = (b"ACCL", b"GYRO"), (b"GPS9", b"GPS5", b"GPRI")


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet of a metadata track, with its start and duration in seconds in the time of the video."""

    time_s: float
    duration_s: float
    data: bytes


@dataclass(frozen=True, slots=True)
class Key:
    """One key of a stream, with its encoded values."""

    name: bytes
    kind: bytes
    size: int
    repeat: int
    value: bytes


def keys(data: bytes) -> Iterator[Key]:
    """Yield the keys of a stream up to its end, or up to the first key that exceeds it."""
    position = 0
    while position + 8 <= len(data):
        name, kind, size, repeat = struct.unpack_from(">4scBH", data, position)
        position += 8
        length = size * repeat
        if name == b"\0\0\0\0" or position + length > len(data):
            return
        yield Key(name, kind, size, repeat, data[position : position + length])
        position += (length + 3) // 4 * 4


def gpmf_telemetry(packets: Sequence[Packet]) -> Telemetry:
    """Read accelerometer, gyroscope and positions of a GPMF track; damaged data are ignored."""
    sensors: dict[bytes, list[tuple[float, float | None, FloatArray]]] = {}
    dilution: list[float] = []
    for packet in packets:
        for stream in _streams(packet.data, 0):
            for name, stamp_s, values in _samples(stream, dilution):
                sensors.setdefault(name, []).append((packet.time_s, stamp_s, values))
    durations = {packet.time_s: packet.duration_s for packet in packets}
    rows = {name: _timed_rows(samples, durations) for name, samples in sensors.items()}
    empty = np.empty((0, 4))
    receiver = next((rows[name] for name in _RECEIVERS if name in rows), None)
    accuracy_m = METRES_PER_DILUTION * float(np.median(dilution)) if dilution else None
    return Telemetry(
        Samples.from_rows(rows.get(b"ACCL", empty)),
        Samples.from_rows(rows.get(b"GYRO", empty)),
        None if receiver is None else Positions.from_rows(receiver, geodetic=True, accuracy_m=accuracy_m),
    )


def _streams(data: bytes, depth: int) -> Iterator[dict[bytes, Key]]:
    """Yield the keys of every `STRM` at any depth, by name."""
    if depth > MAX_DEPTH:
        return
    for key in keys(data):
        if key.kind != b"\0":
            continue
        if key.name == b"STRM":
            yield {field.name: field for field in itertools.islice(keys(key.value), MAX_KEYS)}
        else:
            yield from _streams(key.value, depth + 1)


def _samples(stream: dict[bytes, Key], dilution: list[float]) -> Iterator[tuple[bytes, float | None, FloatArray]]:
    """Yield name, start in seconds (or None) and values (n, 3) of each sensor of a stream that has valid samples.

    Dilutions of precision are appended to `dilution`.
    """
    for name in (*_INERTIAL, *_RECEIVERS):
        if name not in stream:
            continue
        key = stream[name]
        table = _numbers(key, stream[b"TYPE"].value if key.kind == b"?" and b"TYPE" in stream else b"")
        if b"SCAL" in stream and table.size:
            scale = _numbers(stream[b"SCAL"]).ravel()
            if scale.size in (1, table.shape[1]) and (scale != 0).all():
                table = table / scale
        table = table[np.isfinite(table).all(axis=1)]
        values = _in_axis_order(table, stream) if name in _INERTIAL else _fixes(name, table, stream, dilution)
        if len(values):
            stamp = _numbers(stream[b"STMP"]) if b"STMP" in stream else np.empty((0, 1))
            yield name, float(stamp[0, 0]) * 1e-6 if stamp.size else None, values


def _numbers(key: Key, kinds: bytes = b"") -> FloatArray:
    """Return the numbers (n, k) of a key, whose columns have types `kinds` if it is mixed; empty if one is unknown."""
    if key.kind in _DTYPES:
        kinds = key.kind * (key.size // np.dtype(_DTYPES[key.kind]).itemsize)
    columns = [kinds[k : k + 1] for k in range(len(kinds))]
    if not columns or not key.repeat or not _DTYPES.keys() >= set(columns):
        return np.empty((0, 1))
    row = np.dtype([(f"c{k}", _DTYPES[kind]) for k, kind in enumerate(columns)])
    if row.itemsize != key.size:
        return np.empty((0, 1))
    table = np.frombuffer(key.value, row)
    scales = [_FIXED_POINT.get(kind, 1.0) for kind in columns]
    return np.column_stack([table[f"c{k}"].astype(np.float64) / scale for k, scale in enumerate(scales)])


def _in_axis_order(values: FloatArray, stream: dict[bytes, Key]) -> FloatArray:
    """Return values (n, 3) in the order x, y, z, according to `ORIN`: lower case is the opposite of an axis."""
    if values.shape[1] != 3:
        return np.empty((0, 3))
    letters = stream[b"ORIN"].value.decode("latin-1") if b"ORIN" in stream else "XYZ"
    if sorted(letters.upper()) != ["X", "Y", "Z"]:
        return values
    ordered = np.empty_like(values)
    for column, letter in enumerate(letters):
        ordered[:, "XYZ".index(letter.upper())] = values[:, column] * (1 if letter.isupper() else -1)
    return ordered


def _fixes(name: bytes, values: FloatArray, stream: dict[bytes, Key], dilution: list[float]) -> FloatArray:
    """Return latitude, longitude and altitude (n, 3) of the samples with a fix, and append their dilutions."""
    if name == b"GPRI":  # Karma: time, latitude, longitude, altitude, accuracies, speed, heading, fix, satellites
        return values[values[:, 8] >= MIN_FIX, 1:4] if values.shape[1] >= 10 else np.empty((0, 3))
    if name == b"GPS9":  # latitude, longitude, altitude, speeds, days, seconds, dilution, fix
        if values.shape[1] < 9:
            return np.empty((0, 3))
        dilution.extend(values[:, 7].tolist())
        return np.asarray(values[values[:, 8] >= MIN_FIX, :3])
    fix = _numbers(stream[b"GPSF"]) if b"GPSF" in stream else np.empty((0, 1))
    if values.shape[1] < 5 or (fix.size and fix[0, 0] < MIN_FIX):
        return np.empty((0, 3))
    if b"GPSP" in stream and (precision := _numbers(stream[b"GPSP"])).size:
        dilution.append(float(precision[0, 0]) / 100)
    return np.asarray(values[:, :3])


def _timed_rows(samples: Sequence[tuple[float, float | None, FloatArray]], durations: dict[float, float]) -> FloatArray:
    """Return rows (n, 4) of time and values: samples are evenly distributed from one packet to the next.

    Parameters
    ----------
    samples : sequence of (start, stamp, values)
        For each packet its start in the time of the video, the time of its first sample in the clock of the sensor (or
        None), and the values (m, 3).
    durations : dict of float to float
        Durations of the packets by their start.

    Notes
    -----
    The clock of the sensor is used if all packets have it. It starts slightly before the first frame; the alignment
    with the camera path determines the offset.
    """
    packet_starts = [start for start, _, _ in samples]
    stamps = [stamp for _, stamp, _ in samples if stamp is not None]
    has_clock = len(stamps) == len(samples) and all(b > a for a, b in itertools.pairwise(stamps))
    starts = [stamp - stamps[0] + packet_starts[0] for stamp in stamps] if has_clock else packet_starts
    rows, step = [], None
    for k, (start, (packet_start, _, values)) in enumerate(zip(starts, samples, strict=True)):
        is_last = k + 1 == len(starts)
        length = durations.get(packet_start, 0.0) if is_last else starts[k + 1] - start
        # The last packet may contain fewer samples than its duration: it has the step of the packet before.
        if 0 < length < MAX_PACKET_S and not (is_last and step is not None):
            step = length / len(values)
        rows.append(np.column_stack([start + (step or 0.0) * np.arange(len(values)), values]))
    return np.concatenate(rows)
