"""Dense clouds: PLY in every byte order and with any properties, and COLMAP's visibility."""

from __future__ import annotations

import json
import shutil
from contextlib import nullcontext
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.reconstructions.ply import read_dense_cloud, read_visibility, visibility_bytes
from estimator.reconstructions.scene_reader import read_scene
from metric_base.errors import InputError
from tests.synthetic.small_scene import write_small_scene

TYPES = {
    "char": "i1",
    "uchar": "u1",
    "int16": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint32": "u4",
    "float": "f4",
    "double": "f8",
}
ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


@st.composite
def properties(draw: st.DrawFn) -> list[tuple[str, str]]:
    """Names and types of vertex properties, the axes among others in any order."""
    axes = [(axis, draw(st.sampled_from(["float", "double"]))) for axis in "xyz"]
    others = [(f"p{row}", kind) for row, kind in enumerate(draw(st.lists(st.sampled_from(list(TYPES)), max_size=4)))]
    return draw(st.permutations(axes + others))


def ply(form: str, kinds: list[tuple[str, str]], rows: np.ndarray, before: bytes = b"", elements: str = "") -> bytes:
    lines = ["ply", f"format {form} 1.0", "comment made here", *elements.split("\n"), f"element vertex {len(rows)}"]
    lines += [*(f"property {kind} {name}" for name, kind in kinds), "element face 0", "property list uchar int i"]
    header = "\n".join(line for line in [*lines, "end_header"] if line).encode("ascii") + b"\n"
    if form == "ascii":
        return (
            header + before + b"".join(" ".join(repr(value.item()) for value in row).encode() + b"\n" for row in rows)
        )
    return header + before + rows.tobytes()


@settings(max_examples=60, deadline=None)
@given(form=st.sampled_from(list(ORDERS)), kinds=properties(), n=st.integers(1, 20), seed=st.integers(0, 99))
def test_any_properties_in_any_order(
    form: str, kinds: list[tuple[str, str]], n: int, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    rng = np.random.default_rng(seed)
    rows = np.zeros(n, dtype=[(name, ORDERS[form] + TYPES[kind]) for name, kind in kinds])
    for name, _ in kinds:
        rows[name] = rng.normal(size=n) if name in "xyz" else rng.integers(0, 100, n)
    file = tmp_path_factory.mktemp("ply") / "dense.ply"
    file.write_bytes(ply(form, kinds, rows))
    cloud, warnings = read_dense_cloud(file, 1)
    np.testing.assert_array_equal(cloud.points, np.column_stack([rows[axis].astype(float) for axis in "xyz"]))
    assert not warnings
    assert cloud.visible_offsets is None


XYZ = [("x", "float"), ("y", "float"), ("z", "float")]


@pytest.mark.parametrize("form", ORDERS)
def test_elements_before_the_vertices_are_skipped(form: str, tmp_path: Path) -> None:
    rows = np.array([(1, 2, 3)], dtype=[(axis, f"{ORDERS[form]}f4") for axis in "xyz"])
    before = b"5 6\n7 8\n" if form == "ascii" else bytes(2 * 3)
    elements = "element camera 2\nproperty short a\nproperty uchar b"
    (tmp_path / "a.ply").write_bytes(ply(form, XYZ, rows, before, elements))
    assert read_dense_cloud(tmp_path / "a.ply", 1)[0].points.tolist() == [[1, 2, 3]]


def test_windows_line_ends_in_the_header(tmp_path: Path) -> None:
    rows = np.array([(1, 2, 3)], dtype=[(axis, "<f4") for axis in "xyz"])
    data = ply("binary_little_endian", XYZ, rows)
    body = rows.tobytes()
    (tmp_path / "a.ply").write_bytes(data[: -len(body)].replace(b"\n", b"\r\n") + body)
    assert read_dense_cloud(tmp_path / "a.ply", 1)[0].points.tolist() == [[1, 2, 3]]


def vis(lists: list[list[int]]) -> bytes:
    words = [word for views in lists for word in (len(views), *views)]
    return np.uint64(len(lists)).tobytes() + np.array(words, dtype="<u4").tobytes()


@given(lists=st.lists(st.lists(st.integers(0, 9), max_size=5), min_size=1, max_size=10))
@settings(max_examples=40)
def test_visibility_is_read_back(lists: list[list[int]], tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.mktemp("vis") / "dense.ply.vis"
    file.write_bytes(vis(lists))
    offsets, views = read_visibility(file, len(lists), 10)
    assert [views[start:end].tolist() for start, end in pairwise(offsets)] == lists
    assert visibility_bytes(offsets, views) == vis(lists)


def test_points_without_a_position_are_dropped_with_their_visibility(tmp_path: Path) -> None:
    rows = np.array([(1, 2, 3), (np.nan, 0, 0), (4, 5, 6)], dtype=[(axis, "<f4") for axis in "xyz"])
    (tmp_path / "a.ply").write_bytes(ply("binary_little_endian", XYZ, rows))
    (tmp_path / "a.ply.vis").write_bytes(vis([[0, 1], [2], [1]]))
    cloud, warnings = read_dense_cloud(tmp_path / "a.ply", 3)
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.visible_offsets is not None
    assert cloud.visible_offsets.tolist() == [0, 2, 3]
    assert cloud.visible_views is not None
    assert cloud.visible_views.tolist() == [0, 1, 1]
    assert "1 points without a position" in warnings[0]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dense") / "whole"
    write_small_scene(folder)
    return folder


def test_a_cloud_beside_the_model_is_taken_unless_another_is_asked_for(small: Path) -> None:
    assert read_scene(small / "colmap").dense is not None
    assert read_scene(small / "colmap", "none").dense is None
    assert read_scene(small / "text").dense is None
    assert read_scene(small / "text", small / "colmap" / "dense.ply").dense is not None
    with pytest.raises(InputError, match=r"missing\.ply"):
        read_scene(small / "text", small / "missing.ply")


def test_colmaps_visibility_is_renumbered_for_opensfm(small: Path, tmp_path: Path) -> None:
    """The shots are in another order than the model next to the cloud."""
    document = json.loads((small / "opensfm" / "reconstruction.json").read_text(encoding="utf-8"))
    document[0]["shots"] = dict(reversed(document[0]["shots"].items()))
    (tmp_path / "reconstruction.json").write_text(json.dumps(document), encoding="utf-8")
    expected = read_scene(small / "colmap")
    scene = read_scene(tmp_path, small / "colmap" / "dense.ply")
    assert scene.dense is not None
    assert expected.dense is not None
    ours, theirs = scene.dense.visible_views, expected.dense.visible_views
    assert ours is not None
    assert theirs is not None
    names, other = [view.name for view in scene.views], [view.name for view in expected.views]
    assert [names[row] for row in ours] == [other[row] for row in theirs]


def test_visibility_of_another_model_is_refused(small: Path, tmp_path: Path) -> None:
    """Points moved away from the cameras cannot be visible in them."""
    shutil.copytree(small / "colmap", tmp_path / "copy")
    file = tmp_path / "copy" / "dense.ply"
    data = file.read_bytes()
    body = data.index(b"end_header\n") + len(b"end_header\n")
    rows = np.frombuffer(data[body:], dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1")]).copy()
    rows["x"] += 100
    file.write_bytes(data[:body] + rows.tobytes())
    scene = read_scene(tmp_path / "copy")
    assert scene.dense is not None
    assert scene.dense.visible_offsets is None
    assert any("do not project" in warning for warning in scene.warnings)


@pytest.mark.parametrize(("moved", "is_used"), [(2, True), (4, False)])
def test_visibility_is_used_if_19_of_20_points_are_in_the_images_that_see_them(
    small: Path, tmp_path: Path, moved: int, is_used: bool
) -> None:
    shutil.copytree(small / "colmap", tmp_path / "copy")
    file = tmp_path / "copy" / "dense.ply"
    data = file.read_bytes()
    body = data.index(b"end_header\n") + len(b"end_header\n")
    rows = np.frombuffer(data[body:], dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1")]).copy()
    assert len(rows) == 60  # with equally long lists
    rows["x"][:moved] += 100
    file.write_bytes(data[:body] + rows.tobytes())
    scene = read_scene(tmp_path / "copy", file)
    assert scene.dense is not None
    assert (scene.dense.visible_offsets is not None) == is_used


@pytest.mark.parametrize(("excess", "is_read"), [(0, True), (1, False)])
def test_a_header_has_at_most_64_kibibytes(excess: int, is_read: bool, tmp_path: Path) -> None:
    rows = np.array([(1, 2, 3)], dtype=[(axis, "<f4") for axis in "xyz"])
    data = ply("binary_little_endian", XYZ, rows)
    missing = (1 << 16) + excess - data.index(b"end_header") - len(b"end_header")
    comment = b"comment " + b"x" * (missing - len(b"comment \n")) + b"\n"
    (tmp_path / "a.ply").write_bytes(data.replace(b"end_header", comment + b"end_header"))
    with nullcontext() if is_read else pytest.raises(InputError, match="header"):
        assert read_dense_cloud(tmp_path / "a.ply", 1)[0].points.tolist() == [[1, 2, 3]]


def test_a_cloud_needs_a_point_with_a_position_within_the_bounds(tmp_path: Path) -> None:
    file = tmp_path / "a.ply"
    far, near = (1.01e12, 0.0, 0.0), (0.99e12, 0.0, 0.0)
    for points, bounds, n_read in (
        ([far, near], None, 1),
        ([far], None, 0),
        ([near], (np.full(3, -1.0), np.full(3, 1e12)), 1),
        ([near], (np.full(3, -1.0), np.full(3, 0.9e12)), 0),
    ):
        rows = np.array(points, dtype=[(axis, "f8") for axis in "xyz"])
        file.write_bytes(ply("ascii", [(axis, "double") for axis in "xyz"], rows))
        limits = None if bounds is None else np.array(bounds)
        with nullcontext() if n_read else pytest.raises(InputError, match="at least one point near the cameras"):
            assert len(read_dense_cloud(file, 1, limits)[0].points) == n_read
