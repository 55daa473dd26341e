"""Metadata streams in the formats of GoPro (GPMF) and Google (CAMM), and inertial readings of a walk."""

from __future__ import annotations

import struct

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.telemetry.records import Samples
from metric_base.arrays import FloatArray

__all__ = ["camm_packet", "gpmf_key", "gpmf_stream", "walk_readings"]

GRAVITY = 9.80665
_KINDS = {"b": "b", "B": "B", "s": "h", "S": "H", "l": "i", "L": "I", "J": "Q", "f": "f", "d": "d"}


def gpmf_key(name: str, kind: str, rows: object) -> bytes:
    """Return a GPMF key with rows of numbers of one kind, of text (c), or of nested keys (bytes)."""
    if isinstance(rows, bytes):
        size, repeat, value = 1, len(rows), rows
    else:
        table = np.atleast_2d(np.asarray(rows))
        value = b"".join(struct.pack(f">{len(row)}{_KINDS[kind]}", *row.tolist()) for row in table)
        size, repeat = len(value) // len(table), len(table)
    head = struct.pack(">4scBH", name.encode(), b"\0" if kind == "" else kind.encode(), size, repeat)
    return head + value + bytes(-len(value) % 4)


def gpmf_stream(*sensors: list[bytes]) -> bytes:
    """Return a GPMF packet of a device whose sensors are lists of keys."""
    streams = b"".join(gpmf_key("STRM", "", b"".join(keys)) for keys in sensors)
    return gpmf_key("DEVC", "", gpmf_key("DVNM", "c", b"test") + streams)


def camm_packet(kind: int, layout: str, *values: float) -> bytes:
    """Return a CAMM packet."""
    return struct.pack("<HH", 0, kind) + struct.pack(f"<{layout}", *values)


def walk_readings(
    seconds: float, rate_hz: float, swing_m: float, seed: int = 0
) -> tuple[FloatArray, FloatArray, Samples, Samples]:
    """Return times, centres (n, 3) in metres, specific force and angular rate of an inertial unit that is carried.

    The world's third axis is up. The unit swings vertically at twice the frequency of its lateral swing, and pitches.
    """
    generator = np.random.default_rng(seed)
    times = np.arange(0, seconds, 1 / rate_hz)
    phase = 2 * np.pi * 1.8 * times
    centres = np.column_stack(
        [1.3 * times, swing_m * np.sin(phase / 2), swing_m * np.sin(phase) * (1 + 0.2 * np.sin(0.7 * times))]
    )
    turns = Rotation.from_euler("zyx", np.column_stack([0.1 * times, 0.05 * np.sin(phase / 2), 0.04 * np.sin(phase)]))
    step = 1 / rate_hz
    acceleration = np.gradient(np.gradient(centres, step, axis=0), step, axis=0)
    force = (
        turns.inv().apply(acceleration + np.array([0, 0, GRAVITY])) + generator.normal(0, 0.05, centres.shape) + 0.03
    )
    rates = np.vstack([(turns[:-1].inv() * turns[1:]).as_rotvec() / step, np.zeros(3)])
    rates += generator.normal(0, 0.005, rates.shape) + 0.002
    return times, centres, Samples(times, force), Samples(times, rates)
