"""The animations of a glTF file: what each moves, and to where at a time (glTF 2.0, 3.11 and appendix C)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.gltf.accessors import Accessors
from metric_base.arrays import FloatArray
from metric_base.errors import Unquoted, at_field
from metric_base.schema import expect

__all__ = ["Channel", "GltfAnimation", "moved_nodes", "read_animation"]

#: Numbers of each property of a node that may move; the weights of morph targets are as many as the mesh has.
_COLUMNS = {"translation": 3, "rotation": 4, "scale": 3}
_KINDS = ("LINEAR", "STEP", "CUBICSPLINE")
#: Quaternions closer than this are mixed in a straight line.
_ALIKE = 0.9995


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """One property of one node.

    times : (t,) seconds, rising; values : (t, k), or (t, 3, k) with tangents before and after for a cubic spline.
    """

    node: int
    path: str
    kind: str
    times: FloatArray
    values: FloatArray

    def at(self, time_s: float) -> FloatArray:
        """(k,) the property at a time, held before the first key and after the last."""
        row = int(np.clip(np.searchsorted(self.times, time_s, side="right") - 1, 0, len(self.times) - 1))
        points = self.values[:, 1] if self.kind == "CUBICSPLINE" else self.values
        if row == len(self.times) - 1 or time_s <= self.times[0] or self.kind == "STEP":
            return np.asarray(points[row])
        step = float(self.times[row + 1] - self.times[row])
        share = (time_s - float(self.times[row])) / step
        before, after = points[row], points[row + 1]
        if self.kind == "LINEAR":
            mix = _slerp if self.path == "rotation" else _mix
            return mix(before, after, share)
        leave, arrive = step * self.values[row, 2], step * self.values[row + 1, 0]
        s2, s3 = share**2, share**3
        value = (2 * s3 - 3 * s2 + 1) * before + (s3 - 2 * s2 + share) * leave
        value = value + (3 * s2 - 2 * s3) * after + (s3 - s2) * arrive
        return np.asarray(value / np.linalg.norm(value) if self.path == "rotation" else value)


@dataclass(frozen=True, slots=True, eq=False)
class GltfAnimation:
    """An animation by its name; duration_s : the time of the last key of all channels."""

    name: str
    channels: tuple[Channel, ...]
    duration_s: float


def read_animation(header: dict[str, Any], accessors: Accessors, number: int) -> GltfAnimation:
    """An animation of a file. FieldError where its keys are not those of the standard."""
    row = header["animations"][number]
    with at_field(f"animations[{number}]"):
        channels = [_channel(header, accessors, row, stated) for stated in row.get("channels", [])]
    kept = tuple(channel for channel in channels if channel is not None)
    last = max((float(channel.times[-1]) for channel in kept), default=0.0)
    return GltfAnimation(str(row.get("name") or f"animation {number}"), kept, last)


def _channel(
    header: dict[str, Any], accessors: Accessors, row: dict[str, Any], stated: dict[str, Any]
) -> Channel | None:
    """A channel; None for one without a node, or of a property that an extension has added."""
    target = stated.get("target", {})
    path, node = target.get("path"), target.get("node")
    if node is None or path not in (*_COLUMNS, "weights"):
        return None
    expect(isinstance(node, int) and 0 <= node < len(header.get("nodes", [])), "node", "one of the file's", node)
    sampler = row["samplers"][stated["sampler"]]
    kind = sampler.get("interpolation", "LINEAR")
    expect(kind in _KINDS, "interpolation", ", ".join(_KINDS), kind)
    times = accessors.values(sampler["input"], (1,))[:, 0]
    sound = bool(np.isfinite(times).all() and (np.diff(times) > 0).all() and times[0] >= 0)
    expect(sound, "input", "rising times from 0", Unquoted("others"))
    values = accessors.values(sampler["output"], (_COLUMNS.get(path, 1),))
    expect(bool(np.isfinite(values).all()), "output", "finite numbers", Unquoted("others"))
    parts = 3 if kind == "CUBICSPLINE" else 1
    whole = values.size % (len(times) * parts) == 0 and (path == "weights" or len(values) == len(times) * parts)
    expect(whole, "output", f"values for each of {len(times)} times", Unquoted(f"{len(values)}"))
    shape = (len(times), 3, -1) if parts == 3 else (len(times), -1)
    return Channel(node, path, kind, times, values.reshape(shape))


def moved_nodes(nodes: Sequence[Mapping[str, Any]], animation: GltfAnimation, time_s: float) -> list[Mapping[str, Any]]:
    """The records of the nodes with what the animation moves at a time; `weights` are those of morph targets."""
    moved = [dict(node) for node in nodes]
    for channel in animation.channels:
        moved[channel.node].pop("matrix", None)  # a node that moves has none, by the standard
        moved[channel.node][channel.path] = channel.at(time_s)
    return list(moved)


def _mix(before: FloatArray, after: FloatArray, share: float) -> FloatArray:
    """(k,) between two values."""
    return np.asarray((1 - share) * before + share * after)


def _slerp(before: FloatArray, after: FloatArray, share: float) -> FloatArray:
    """(4,) between two unit quaternions, the short way round."""
    cosine = float(before @ after)
    after, cosine = (-after, -cosine) if cosine < 0 else (after, cosine)
    if cosine > _ALIKE:
        mixed = _mix(before, after, share)
        return np.asarray(mixed / np.linalg.norm(mixed))
    angle = np.arccos(cosine)
    return np.asarray((np.sin((1 - share) * angle) * before + np.sin(share * angle) * after) / np.sin(angle))
