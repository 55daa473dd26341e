"""Google's Camera Motion Metadata (CAMM) of Android and 360 degree cameras.

https://developers.google.com/streetview/publish/camm-spec: a packet is two reserved bytes, its type in two, and little
endian numbers.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from estimator.telemetry.gpmf import Packet
from estimator.telemetry.records import Positions, Samples, Telemetry

__all__ = ["camm_telemetry", "is_camm"]

#: Layout of the packets by type, after their first four bytes.
LAYOUTS = {0: "<3f", 1: "<2i", 2: "<3f", 3: "<3f", 4: "<3f", 5: "<3d", 6: "<di2d7f", 7: "<3f"}
GYROSCOPE, ACCELEROMETER, PLACE, FULL_PLACE = 2, 3, 5, 6
#: Least kind of fix of a full position: 2 is without altitude, 3 with it.
LEAST_FIX = 2


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
    return Telemetry(_samples(rows.get(ACCELEROMETER, [])), _samples(rows.get(GYROSCOPE, [])), _positions(rows))


def _samples(rows: list[tuple[float, ...]]) -> Samples:
    table = np.array(sorted(rows), dtype=np.float64).reshape(-1, 4)
    table = table[np.isfinite(table).all(axis=1)]
    table = table[np.diff(table[:, 0], prepend=-np.inf) > 0]
    return Samples(table[:, 0], table[:, 1:])


def _positions(rows: dict[int, list[tuple[float, ...]]]) -> Positions | None:
    full = [row for row in rows.get(FULL_PLACE, []) if row[2] >= LEAST_FIX]
    accuracy = float(np.median([row[6] for row in full])) if full else None
    plain = [(row[0], row[3], row[4], row[5]) for row in full] or rows.get(PLACE, [])
    samples = _samples([(row[0], row[1], row[2], row[3]) for row in plain])
    if not len(samples):
        return None
    known = accuracy is not None and np.isfinite(accuracy) and accuracy > 0
    return Positions(samples.times_s, samples.values, geodetic=True, accuracy_m=accuracy if known else None)
