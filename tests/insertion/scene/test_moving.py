"""Models that move: skins, morph targets and node animations of generated glTF files, and ways over a floor."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insertion.placement.path import path_motion
from insertion.request import parse_path
from metric_base.errors import InputError
from models3d.animation_playback import select_playback
from models3d.gltf.animation import Channel
from models3d.gltf.boxes import read_gltf
from models3d.gltf.document import GltfWriter
from models3d.gltf.model_reader import read_model
from models3d.model import Model

#: Two triangles: a foot at y = 0 .. 1 and a head at y = 2 .. 3.
POINTS = np.array([[0, 0, 0], [0.5, 0, 0], [0, 1, 0], [0, 2, 0], [0.5, 2, 0], [0, 3, 0.0]])
FACES = np.arange(6)
QUARTER = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]


def _file(file: Path, build: Callable[[GltfWriter, dict[str, Any]], list[int]]) -> Path:
    """A GLB file of the two triangles; `build` adds to the document and its primitive, and gives the root nodes."""
    document = GltfWriter("test")
    primitive: dict[str, Any] = {
        "attributes": {"POSITION": document.add_accessor(POINTS, bounds=True)}, "indices": document.add_accessor(FACES)
    }  # fmt: skip
    file.write_bytes(document.to_bytes(build(document, primitive)))
    return file


def _animate(document: GltfWriter, node: int, path: str, times: list[float], values: Any, kind: str = "LINEAR") -> None:
    keys, output = document.add_accessor(np.array(times), bounds=True), document.add_accessor(np.array(values))
    sampler = {"input": keys, "output": output, "interpolation": kind}
    document.add("animations", {
        "name": path, "samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": node, "path": path}}]
    })  # fmt: skip


def _corners(model: Model) -> np.ndarray:
    """(6, 3) vertices in the order of the faces."""
    (part,) = model.meshes
    return part.vertices[part.faces.reshape(-1)]


def _skinned(document: GltfWriter, primitive: dict[str, Any]) -> list[int]:
    """The head hangs on the second joint, which is bound at y = 2; the mesh's own node must not count."""
    weights = np.zeros((6, 4))
    weights[:, 0] = 1.0
    joints = np.zeros((6, 4))
    joints[3:, 0] = 1.0
    primitive["attributes"] |= {"JOINTS_0": document.add_accessor(joints), "WEIGHTS_0": document.add_accessor(weights)}
    document.add("meshes", {"primitives": [primitive]})
    inverse = np.stack([np.eye(4), np.eye(4)])
    inverse[1, 1, 3] = -2.0
    bind = document.add_accessor(inverse.transpose(0, 2, 1).reshape(2, 16))
    document.add("skins", {"joints": [1, 2], "inverseBindMatrices": bind})
    document.add("nodes", {"mesh": 0, "skin": 0, "translation": [70.0, 0.0, 0.0]})
    document.add("nodes", {"children": [2]})
    document.add("nodes", {"translation": [0.0, 2.0, 0.0]})
    _animate(document, 2, "rotation", [0.0, 2.0], [[0, 0, 0, 1.0], QUARTER])
    return [0, 1]


def test_a_skin_turns_the_head_about_its_joint(tmp_path: Path) -> None:
    file = _file(tmp_path / "skin.glb", _skinned)
    model = read_model(file)
    np.testing.assert_allclose(_corners(model), POINTS, atol=1e-6)  # rest: the node's own transform does not count
    for time_s, angle in ((0.0, 0.0), (1.0, 45.0), (1.5, 67.5), (2.5, 22.5)):  # the motion repeats after 2 s
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        head = (POINTS[3:] - [0, 2, 0]) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [0, 2, 0]
        np.testing.assert_allclose(_corners(model.posed(model.animations[0], time_s)), [*POINTS[:3], *head], atol=1e-6)
    (body,) = read_gltf(file).bodies
    np.testing.assert_allclose([body.low_m, body.high_m], [POINTS.min(axis=0), POINTS.max(axis=0)], atol=1e-6)


def test_a_morph_target_moves_by_its_weight(tmp_path: Path) -> None:
    rise = np.zeros((6, 3))
    rise[5, 1] = 2.0

    def build(document: GltfWriter, primitive: dict[str, Any]) -> list[int]:
        primitive["targets"] = [{"POSITION": document.add_accessor(rise)}]
        document.add("meshes", {"primitives": [primitive], "weights": [0.25]})
        _animate(document, document.add("nodes", {"mesh": 0}), "weights", [0.0, 1.0], [0.0, 1.0])
        return [0]

    model = read_model(_file(tmp_path / "morph.glb", build))
    assert _corners(model)[5, 1] == pytest.approx(3.5)
    assert _corners(model.posed(model.animations[0], 0.75))[5, 1] == pytest.approx(4.5)


def test_a_node_turns_its_mesh_and_a_mirror_keeps_faces_outside(tmp_path: Path) -> None:
    def build(document: GltfWriter, primitive: dict[str, Any]) -> list[int]:
        document.add("meshes", {"primitives": [primitive]})
        node = document.add("nodes", {"mesh": 0, "scale": [-1.0, 1.0, 1.0]})
        _animate(document, node, "rotation", [0.0, 1.0], [[0, 0, 0, 1.0], QUARTER])
        return [node]

    model = read_model(_file(tmp_path / "turn.glb", build))
    turned = model.posed(model.animations[0], 0.9999999)
    low, high = turned.bounds
    np.testing.assert_allclose([low, high], [[-3, -0.5, 0], [0, 0, 0]], atol=1e-5)
    for part in (model.meshes[0], turned.meshes[0]):
        corners = part.vertices[part.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (across[:, 2] > 0).all()  # the file's own faces look along +z, and a mirror in x keeps that
        np.testing.assert_allclose(part.normals[part.faces[:, 0]], [[0, 0, 1]] * 2, atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.01, 5.0), min_size=2, max_size=6), st.floats(0.0, 1.0), st.integers(0, 2**31))
def test_keys_are_met_and_a_spline_of_a_line_is_the_line(steps: list[float], share: float, seed: int) -> None:
    times = np.cumsum(steps)
    values = np.random.default_rng(seed).normal(size=(len(times), 3))
    for kind in ("LINEAR", "STEP"):
        channel = Channel(0, "translation", kind, times, values)
        np.testing.assert_allclose([channel.at(t) for t in times], values, atol=1e-12)
    slope = np.array([2.0, -1.0, 0.5])
    line = times[:, None] * slope
    spline = np.stack([np.broadcast_to(slope, line.shape), line, np.broadcast_to(slope, line.shape)], axis=1)
    at = times[0] + share * (times[-1] - times[0])
    np.testing.assert_allclose(Channel(0, "scale", "CUBICSPLINE", times, spline).at(at), at * slope, atol=1e-9)


def test_what_plays_is_chosen_and_stands_by_its_lowest_moment(tmp_path: Path) -> None:
    def build(document: GltfWriter, primitive: dict[str, Any]) -> list[int]:
        document.add("meshes", {"primitives": [primitive]})
        node = document.add("nodes", {"mesh": 0})
        _animate(document, node, "translation", [0.0, 1.0, 2.0], [[0, 1.0, 0], [0, 0, 0], [0, 1.0, 0]])
        return [node]

    model = read_model(_file(tmp_path / "jump.glb", build))
    jumping = select_playback(model, None, None)
    assert jumping.animation is not None
    assert jumping.bounds[0, 1] == pytest.approx(0.0)  # it begins a metre above where it lands
    assert jumping.posed(0.0).bounds[0, 1] == pytest.approx(1.0)
    assert jumping.bounds_over_time[1, 1] == pytest.approx(4.0)
    still = select_playback(model, "0", 0.5)
    assert still.animation is None
    assert still.model.bounds[0, 1] == pytest.approx(0.5)
    assert select_playback(model, "none", None).animation is None
    with pytest.raises(InputError, match=r"--clip: expected none or one of jump.glb \(translation\); found 'run'"):
        select_playback(model, "run", None)
    with pytest.raises(InputError, match="--at-time: expected a model with an animation"):
        select_playback(model, "none", 1.0)


@pytest.mark.parametrize(
    ("times", "values", "words"),
    [
        ([0.0, 0.0], [[0, 0, 0], [1, 0, 0.0]], "rising times"),
        ([0.0, 1.0], [[0, 0, 0.0]], "values for each of 2 times"),
        ([0.0, 1.0], [[0, 0, 0], [np.nan, 0, 0.0]], "finite numbers"),
    ],
)
def test_keys_that_are_none_are_refused(tmp_path: Path, times: list[float], values: Any, words: str) -> None:
    def build(document: GltfWriter, primitive: dict[str, Any]) -> list[int]:
        document.add("meshes", {"primitives": [primitive]})
        _animate(document, document.add("nodes", {"mesh": 0}), "translation", times, values)
        return [0]

    with pytest.raises(InputError, match=words):
        read_model(_file(tmp_path / "bad.glb", build))


def test_a_way_is_walked_at_one_speed_with_the_front_ahead() -> None:
    corners = np.array([[0, 0, 0], [3, 0, 0], [3, 1, 0.0]])
    whole = path_motion(corners, 2.0, None, 8.0)
    np.testing.assert_allclose(whole.position(0), corners[0])
    np.testing.assert_allclose(whole.position(3), [1.5, 0, 0])
    np.testing.assert_allclose(whole.position(99), corners[2])
    np.testing.assert_allclose(whole.front(3), [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(whole.front(8), [0, 1, 0], atol=1e-9)
    assert whole.arrival_s == pytest.approx(8.0)
    assert path_motion(corners, 2.0, 1.0, 0.0).arrival_s == pytest.approx(8.0)  # 4 units are 8 m
    late = path_motion(corners, 2.0, None, 8.0, start_s=4.0)
    expected = [corners[0], corners[0], [1, 0, 0], corners[2]]
    np.testing.assert_allclose([late.position(time_s) for time_s in (0, 4, 5, 8)], expected)
    np.testing.assert_allclose(late.front(2), [1, 0, 0], atol=1e-9)
    with pytest.raises(InputError, match="--path-start: expected less than the 8 s"):
        path_motion(corners, 2.0, None, 8.0, start_s=8.0)
    for words in ("", "1", "1,2,3", "1,a", "1,nan"):
        with pytest.raises(InputError, match="--path"):
            parse_path(words)
    assert parse_path("1,2 3,4.5") == ((1.0, 2.0), (3.0, 4.5))
    with pytest.raises(InputError, match="--path: expected points other"):
        path_motion(np.zeros((2, 3)), 1.0, None, 1.0)
