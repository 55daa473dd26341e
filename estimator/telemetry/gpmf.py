"""GoPro's metadata format (GPMF), after its public description: https://gopro.github.io/gpmf-parser/.

A stream is a row of keys: four letters, a type, the size of one value, how many there are, and the values, big endian,
padded to four bytes. Type 0 holds keys itself. A sensor is a key `STRM` with its samples last and what applies to them
before: `SCAL` divides, `ORIN` names the axes, `STMP` is the time of the first sample in microseconds.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from estimator.telemetry.records import Positions, Samples, Telemetry
from metric_base.arrays import FloatArray

#: Depth at which nested keys are no longer followed, and keys of one packet that are looked at.
MAX_DEPTH, MAX_KEYS = 8, 100_000
#: NumPy's names for the numbers of GPMF; Q numbers are fixed point.
NUMBERS = {b"b": ">i1", b"B": ">u1", b"s": ">i2", b"S": ">u2", b"l": ">i4", b"L": ">u4", b"j": ">i8", b"J": ">u8"}
NUMBERS |= {b"f": ">f4", b"d": ">f8", b"q": ">i4", b"Q": ">i8"}
FIXED_POINT = {b"q": 2.0**16, b"Q": 2.0**32}
#: Least kind of fix: 2 is a position without altitude, 3 one with it.
LEAST_FIX = 2
#: Metres of one position per unit of dilution of precision, as consumer receivers have it.
METRES_PER_DILUTION = 2.5
#: Gap in seconds between packets, above which samples are not spread over it.
LONGEST_PACKET_S = 10.0


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet of a metadata track: its time and length in seconds on the clock of the video, and its bytes."""

    time_s: float
    duration_s: float
    data: bytes


@dataclass(frozen=True, slots=True)
class _Key:
    name: bytes
    kind: bytes
    size: int
    repeat: int
    value: bytes


@dataclass(slots=True)
class _Sensor:
    """Samples of one sensor over the packets: start of each packet's samples in seconds, and their values (n, k)."""

    starts: list[float] = field(default_factory=list)
    stamps: list[float | None] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)


def keys(data: bytes) -> Iterator[_Key]:
    """The keys of a stream up to its end, or to what does not fit."""
    at = 0
    while at + 8 <= len(data):
        name, kind, size, repeat = struct.unpack_from(">4scBH", data, at)
        at += 8
        length = size * repeat
        if name == b"\0\0\0\0" or at + length > len(data):
            return
        yield _Key(name, kind, size, repeat, data[at : at + length])
        at += (length + 3) // 4 * 4


def gpmf_telemetry(packets: Sequence[Packet]) -> Telemetry:
    """Accelerometer, gyroscope and positions of a GPMF track; what is damaged is left out."""
    sensors: dict[bytes, _Sensor] = {}
    dilution: list[float] = []
    for packet in packets:
        for rows in _streams(packet.data, 0):
            _add(rows, packet.time_s, sensors, dilution)
    ends = {packet.time_s: packet.duration_s for packet in packets}
    fallback = {name: _times_and_values(sensor, ends) for name, sensor in sensors.items()}
    positions = next((fallback[name] for name in (b"GPS9", b"GPS5", b"GPRI") if name in fallback), None)
    return Telemetry(
        _vectors(fallback.get(b"ACCL")),
        _vectors(fallback.get(b"GYRO")),
        _positions(positions, METRES_PER_DILUTION * float(np.median(dilution)) if dilution else None),
    )


def _streams(data: bytes, depth: int) -> Iterator[list[_Key]]:
    """The keys of every `STRM`, however deep."""
    if depth > MAX_DEPTH:
        return
    for key in keys(data):
        if key.kind != b"\0":
            continue
        if key.name == b"STRM":
            yield [row for _, row in zip(range(MAX_KEYS), keys(key.value), strict=False)]
        else:
            yield from _streams(key.value, depth + 1)


def _add(rows: list[_Key], time_s: float, sensors: dict[bytes, _Sensor], dilution: list[float]) -> None:
    about = {row.name: row for row in rows}
    for name in (b"ACCL", b"GYRO", b"GPS5", b"GPS9", b"GPRI"):
        if name not in about:
            continue
        values = _values(about[name], about)
        values = _in_axis_order(values, about) if name in (b"ACCL", b"GYRO") else _places(name, values, about, dilution)
        stamp = _numbers(about[b"STMP"]) if b"STMP" in about else np.empty((0, 1))
        if len(values):
            sensor = sensors.setdefault(name, _Sensor())
            sensor.starts.append(time_s)
            sensor.stamps.append(float(stamp[0, 0]) * 1e-6 if stamp.size else None)
            sensor.values.append(values)


def _numbers(key: _Key) -> FloatArray:
    """(n, k) numbers of a key, empty where they are of no known type."""
    dtype = np.dtype(NUMBERS[key.kind]) if key.kind in NUMBERS else None
    if dtype is None or key.size % dtype.itemsize or not key.repeat:
        return np.empty((0, 1))
    table = np.frombuffer(key.value, dtype).reshape(key.repeat, -1).astype(np.float64)
    return np.asarray(table / FIXED_POINT.get(key.kind, 1.0))


def _values(key: _Key, about: dict[bytes, _Key]) -> FloatArray:
    """(n, k) scaled values of the samples, which may be of several types side by side (`TYPE`)."""
    table = _columns_of_types(key, about[b"TYPE"].value) if key.kind == b"?" and b"TYPE" in about else _numbers(key)
    if b"SCAL" in about and table.size:
        scale = _numbers(about[b"SCAL"]).ravel()
        if scale.size in (1, table.shape[1]) and (scale != 0).all():
            table = table / scale
    return np.asarray(table[np.isfinite(table).all(axis=1)])


def _columns_of_types(key: _Key, kinds: bytes) -> FloatArray:
    """(n, k) numbers of rows whose columns are of several types."""
    types = [NUMBERS.get(kinds[k : k + 1]) for k in range(len(kinds))]
    if not types or any(kind is None for kind in types):
        return np.empty((0, 1))
    row = np.dtype([(f"c{k}", kind) for k, kind in enumerate(types) if kind is not None])
    if row.itemsize != key.size or not key.repeat:
        return np.empty((0, 1))
    table = np.frombuffer(key.value, row)
    return np.column_stack([table[name].astype(np.float64) for name in table.dtype.names or ()])


def _in_axis_order(values: FloatArray, about: dict[bytes, _Key]) -> FloatArray:
    """(n, 3) in the order x, y, z by `ORIN`: a capital letter is the axis, a small one its opposite."""
    if values.shape[1] != 3:
        return np.empty((0, 3))
    letters = about[b"ORIN"].value.decode("latin-1") if b"ORIN" in about else "XYZ"
    if sorted(letters.upper()) != ["X", "Y", "Z"]:
        return values
    oriented = np.empty_like(values)
    for column, letter in enumerate(letters):
        oriented[:, "XYZ".index(letter.upper())] = values[:, column] * (1 if letter.isupper() else -1)
    return oriented


def _places(name: bytes, values: FloatArray, about: dict[bytes, _Key], dilution: list[float]) -> FloatArray:
    """(n, 3) latitude, longitude, altitude of samples with a fix; their dilution of precision is added to the list."""
    if name == b"GPRI":  # Karma: time, latitude, longitude, altitude, accuracies, speed, heading, fix, satellites
        return values[values[:, 8] >= LEAST_FIX, 1:4] if values.shape[1] >= 10 else np.empty((0, 3))
    if name == b"GPS9":  # ... speeds, days, seconds, dilution, fix
        if values.shape[1] < 9:
            return np.empty((0, 3))
        dilution.extend(values[:, 7].tolist())
        return np.asarray(values[values[:, 8] >= LEAST_FIX, :3])
    fix = _numbers(about[b"GPSF"]) if b"GPSF" in about else np.empty((0, 1))
    if values.shape[1] < 5 or (fix.size and fix[0, 0] < LEAST_FIX):
        return np.empty((0, 3))
    if b"GPSP" in about and (precision := _numbers(about[b"GPSP"])).size:
        dilution.append(float(precision[0, 0]) / 100)
    return np.asarray(values[:, :3])


def _times_and_values(sensor: _Sensor, durations: dict[float, float]) -> tuple[FloatArray, FloatArray]:
    """Times (n,) and values (n, k): samples are evenly spread from the start of their packet to that of the next.

    The packets' own clock is used where all have one; it begins before the first frame by an unknown, small time, which
    the alignment with the path of the camera finds.
    """
    stamps = [stamp for stamp in sensor.stamps if stamp is not None]
    own = len(stamps) == len(sensor.values) and all(b > a for a, b in itertools.pairwise(stamps))
    starts = [stamp - stamps[0] + sensor.starts[0] for stamp in stamps] if own else sensor.starts
    times, step = [], None
    for k, (start, values) in enumerate(zip(starts, sensor.values, strict=True)):
        length = starts[k + 1] - start if k + 1 < len(starts) else durations.get(sensor.starts[k], 0.0)
        if 0 < length < LONGEST_PACKET_S and not (k + 1 == len(starts) and step is not None):
            step = length / len(values)  # the last packet may be shorter than its time: the step of the one before
        times.append(start + (step or 0.0) * np.arange(len(values)))
    whole, table = np.concatenate(times), np.concatenate(sensor.values)
    kept = np.diff(whole, prepend=-np.inf) > 0
    return whole[kept], table[kept]


def _vectors(timed: tuple[FloatArray, FloatArray] | None) -> Samples:
    """Times (n,) and values (n, 3) as samples; none of None."""
    return Samples(np.empty(0), np.empty((0, 3))) if timed is None else Samples(*timed)


def _positions(timed: tuple[FloatArray, FloatArray] | None, accuracy_m: float | None) -> Positions | None:
    """Times (n,) and places (n, 3) as positions."""
    return None if timed is None else Positions(*timed, geodetic=True, accuracy_m=accuracy_m)
