"""Depth maps in metres, and the baselines of a rig."""

from __future__ import annotations

import base64
import json
import math
import struct
import zlib
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from estimator.evidence import depth_maps
from estimator.evidence.depth_maps import MetricDepth, frame_sd, network_sd
from estimator.evidence.rig_baseline import RigBaseline, parse_rig_baselines, rig_baselines
from estimator.projection.cameras import pixels_in_view
from estimator.records.objects import Measurements
from estimator.records.scene import DenseCloud
from estimator.scene_formats.depth_files import read_depth
from metric_base.errors import InputError
from tests.synthetic.evidence import RIG_M, one
from tests.synthetic.walk import Walk, with_rig


def test_a_folder_without_depth_maps(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    assert one(MetricDepth(tmp_path).observe(walk.scene, nothing)).scale is None
    with pytest.raises(InputError, match="no such folder"):
        MetricDepth(tmp_path / "nowhere").observe(walk.scene, nothing)


@pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.exr", "a.pfm", "a.png"])
@given(content=st.binary(max_size=300))
@example(content=b"PK\x03\x04")  # an archive's first bytes
@example(content=b"\x93NUMPY\x01\x00")
def test_damaged_depth_maps_are_one_line(tmp_path_factory: pytest.TempPathFactory, name: str, content: bytes) -> None:
    file = tmp_path_factory.mktemp("depth") / name
    file.write_bytes(content)
    with pytest.raises(InputError, match=name):
        read_depth(file)


#: 3 x 5 pixels of a half channel Y, ZIPS, as the library OpenEXR wrote it.
EXR = base64.b64decode(
    "di8xAQIAAABjaGFubmVscwBjaGxpc3QAEwAAAFkAAQAAAAAAAAABAAAAAQAAAABjb21wcmVzc2lvbgBjb21wcmVzc2lvbgABAAAA"
    "AmRhdGFXaW5kb3cAYm94MmkAEAAAAAAAAAAAAAAABAAAAAIAAABkaXNwbGF5V2luZG93AGJveDJpABAAAAAAAAAAAAAAAAQAAAAC"
    "AAAAbGluZU9yZGVyAGxpbmVPcmRlcgABAAAAAHBpeGVsQXNwZWN0UmF0aW8AZmxvYXQABAAAAAAAgD9zY3JlZW5XaW5kb3dDZW50"
    "ZXIAdjJmAAgAAAAAAAAAAAAAAHNjcmVlbldpbmRvd1dpZHRoAGZsb2F0AAQAAAAAAIA/dHlwZQBzdHJpbmcADQAAAHNjYW5saW5l"
    "aW1hZ2UASgEAAAAAAABcAQAAAAAAAG4BAAAAAAAAAAAAAAoAAAAAOAA6ADwAPQA+AQAAAAoAAAAAPwBAgEAAQYBBAgAAAAoAAAAA"
    "QoBCAEOAQwBE"
)


def test_an_exr_of_the_librarys_own_writer(tmp_path: Path) -> None:
    (tmp_path / "a.exr").write_bytes(EXR)
    assert read_depth(tmp_path / "a.exr") == pytest.approx(0.5 + np.arange(15).reshape(3, 5) / 4)
    (tmp_path / "a.exr").write_bytes(EXR[:-4])
    with pytest.raises(InputError, match="OpenEXR"):
        read_depth(tmp_path / "a.exr")


def maps_of(walk: Walk) -> dict[str, np.ndarray]:
    """A map of metres for each view: the depth of the scene's own points, each in its pixel."""
    maps = {}
    for view in walk.scene.views:
        pixels, depths = pixels_in_view(view, walk.scene.points)
        metres = np.full((view.camera.height, view.camera.width), np.nan)
        inside = np.isfinite(pixels).all(axis=1) & (depths > 0)
        column, line = np.floor(pixels[inside]).astype(int).T
        here = (column >= 0) & (column < metres.shape[1]) & (line >= 0) & (line < metres.shape[0])
        metres[line[here], column[here]] = depths[inside][here] * walk.scale
        maps[view.name] = metres
    return maps


@pytest.mark.parametrize("form", ["moge", "depth_pro", "unidepth", "da3", "mapanything", "metric3d", "unidepth_v2"])
def test_what_networks_write(walk: Walk, nothing: Measurements, tmp_path: Path, form: str) -> None:
    """Each in its form, and all say the scale of the scene."""
    maps, unit = maps_of(walk), "metres"
    focal = float(walk.scene.views[0].camera.params[0])
    stacked = np.stack([maps[name] for name in sorted(maps)])
    if form == "da3":
        matrix = np.tile(np.diag([focal, focal, 1.0]), (len(maps), 1, 1))
        np.savez(tmp_path / "results.npz", depth=stacked * 300 / focal, intrinsics=matrix, conf=stacked)
        unit = "da3"
    elif form == "mapanything":
        np.savez(tmp_path / "results.npz", depth_z=stacked[..., None], depth_along_ray=2 * stacked[..., None])
    for name, metres in maps.items():
        stem = Path(name).stem
        if form == "moge":
            (tmp_path / stem).mkdir(exist_ok=True)
            np.save(tmp_path / stem / "depth.npy", metres)
        elif form == "depth_pro":
            np.savez(tmp_path / f"{stem}.npz", depth=metres, focallength_px=focal)
        elif form == "unidepth":
            np.save(tmp_path / f"{stem}_depth.npy", metres[None, None])
        elif (
            form == "unidepth_v2"
        ):  # `infer` of unidepthv2.py; its confidence is the exponential of the error in metres
            rays = np.zeros((1, 3, *metres.shape))
            np.savez(
                tmp_path / f"{stem}.npz", depth=metres[None, None], rays=rays, confidence=np.exp(0.3 * metres)[None]
            )
        elif form == "metric3d":
            np.save(tmp_path / f"{stem}.npy", metres * 1000 / focal)
            unit = "metric3d"
    row = one(MetricDepth(tmp_path, unit=unit, network_sd=0.1).observe(walk.scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=0.02)
    assert row.sd_log is not None
    assert 0.1 < row.sd_log < 0.15
    expected = math.hypot(0.1, frame_sd(np.zeros(len(maps)), 0.3 if form == "unidepth_v2" else 0.1) / len(maps) ** 0.5)
    assert row.sd_log == pytest.approx(expected, rel=0.02)


def test_too_few_maps_in_a_stack_are_one_line(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    np.savez(tmp_path / "results.npz", depth=np.ones((1, 4, 4)))
    with pytest.raises(InputError, match=r"results\.npz: maps"):
        MetricDepth(tmp_path).observe(walk.scene, nothing)


def test_a_single_picture_knows_nothing_of_the_spread_between_pictures() -> None:
    assert frame_sd(np.zeros(1)) == pytest.approx(0.1)
    many = np.random.default_rng(0).normal(0, 0.2, 200)
    assert frame_sd(many) == pytest.approx(0.2, rel=0.15)


def test_the_baseline_of_a_rig(walk: Walk, nothing: Measurements) -> None:
    row = one(RigBaseline("left", "right", RIG_M).observe(with_rig(walk, RIG_M).scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=1e-6)
    assert row.sd_log == pytest.approx(0.005)  # the distances of the pairs are equal
    assert one(RigBaseline("left", "right", RIG_M).observe(walk.scene, nothing)).scale is None


def test_the_baselines_of_colmaps_rig_configuration(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    """A file that pycolmap reads as well."""
    file = tmp_path / "rig_config.json"
    moved = {
        "image_prefix": "right/",
        "cam_from_rig_rotation": [1, 0, 0, 0],
        "cam_from_rig_translation": [-RIG_M, 0, 0],
    }
    file.write_text(json.dumps([{"cameras": [{"image_prefix": "left/", "ref_sensor": True}, moved]}]), encoding="utf-8")
    assert pycolmap.read_rig_config(file)[0].cameras[1].cam_from_rig.translation[0] == -RIG_M
    (baseline,) = rig_baselines(file)
    row = one(baseline.observe(with_rig(walk, RIG_M).scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=1e-6)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{}",
        '[{"cameras": [{"image_prefix": "a/"}]}]',
        '[{"cameras": [{"image_prefix": "a/", "ref_sensor": true}, {"image_prefix": "b/"}]}]',
        '[{"cameras": [{"image_prefix": "a/", "ref_sensor": true},'
        ' {"image_prefix": "b/", "cam_from_rig_translation": [0, 0]}]}]',
    ],
)
def test_a_rig_configuration_without_a_baseline_is_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "rig_config.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"rig_config\.json") as error:
        rig_baselines(tmp_path / "rig_config.json")
    assert "\n" not in str(error.value)


def _exr_file(channels: dict[str, np.ndarray], compression: int) -> bytes:
    """An OpenEXR image of float channels, by the layout of openexr.com; blocks are packed whatever their size."""
    height, width = next(iter(channels.values())).shape

    def field(name: str, kind: str, data: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data

    rows = b"".join(name.encode() + b"\0" + struct.pack("<iIii", 2, 0, 1, 1) for name in sorted(channels)) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    head = struct.pack("<II", 20000630, 2) + field("channels", "chlist", rows)
    head += field("compression", "compression", bytes([compression])) + field("dataWindow", "box2i", window) + b"\0"
    step = {0: 1, 2: 1, 3: 16}[compression]
    blocks = []
    for first in range(0, height, step):
        lines = range(first, min(first + step, height))
        data = b"".join(channels[name][row].astype("<f4").tobytes() for row in lines for name in sorted(channels))
        if compression:
            plain = np.frombuffer(data, np.uint8)
            halves = np.concatenate([plain[0::2], plain[1::2]])
            differences = np.concatenate([halves[:1], np.diff(halves) + np.uint8(128)]).astype(np.uint8)
            data = zlib.compress(differences.tobytes())
        blocks.append(struct.pack("<ii", first, len(data)) + data)
    places = np.cumsum([len(head) + 8 * len(blocks), *(len(block) for block in blocks)])[:-1]
    return head + places.astype("<u8").tobytes() + b"".join(blocks)


@pytest.mark.parametrize("compression", [0, 2, 3])
def test_the_depth_among_other_channels(compression: int, tmp_path: Path) -> None:
    generator = np.random.default_rng(3)
    channels = {name: generator.normal(5, 1, (19, 7)).astype(np.float32) for name in ("A", "B", "Z")}
    (tmp_path / "a.exr").write_bytes(_exr_file(channels, compression))
    assert np.array_equal(read_depth(tmp_path / "a.exr"), channels["Z"])


@pytest.mark.parametrize(
    ("magic", "version", "words"),
    [(20000629, 2, "another format"), (20000631, 2, "another format"), (20000630, 0x202, "tiles, deep data")],
)
def test_what_kind_of_exr_is_not_read_is_said(magic: int, version: int, words: str, tmp_path: Path) -> None:
    data = _exr_file({"Z": np.ones((2, 3), dtype=np.float32)}, 0)
    (tmp_path / "a.exr").write_bytes(struct.pack("<II", magic, version) + data[8:])
    with pytest.raises(InputError, match=words):
        read_depth(tmp_path / "a.exr")


@pytest.mark.parametrize("damage", ["far offset", "type below none"])
def test_an_exr_that_points_elsewhere_is_one_line(damage: str, tmp_path: Path) -> None:
    data = _exr_file({"Z": np.ones((2, 3), dtype=np.float32)}, 0)
    blocks = len(data) - 2 * (8 + 4 * 3) - 2 * 8
    broken = {
        "far offset": data[:blocks] + struct.pack("<2Q", 2**64 - 1, 2**64 - 1) + data[blocks + 16 :],
        "type below none": data.replace(struct.pack("<iIii", 2, 0, 1, 1), struct.pack("<iIii", -1, 0, 1, 1)),
    }[damage]
    (tmp_path / "a.exr").write_bytes(broken)
    with pytest.raises(InputError, match="OpenEXR"):
        read_depth(tmp_path / "a.exr")


@pytest.mark.parametrize(("size", "is_read"), [(0, True), (-1, False)])
def test_a_field_of_an_exr_may_be_empty_but_not_negative(size: int, is_read: bool, tmp_path: Path) -> None:
    data = _exr_file({"Z": np.ones((2, 3), dtype=np.float32)}, 0)
    field = b"comments\0string\0" + struct.pack("<i", size)
    blocks = len(data) - 2 * (8 + 4 * 3) - 2 * 8
    places = np.frombuffer(data[blocks : blocks + 16], dtype="<u8") + np.uint64(len(field))
    (tmp_path / "a.exr").write_bytes(data[:8] + field + data[8:blocks] + places.tobytes() + data[blocks + 16 :])
    if is_read:
        assert np.array_equal(read_depth(tmp_path / "a.exr"), np.ones((2, 3)))
    else:
        with pytest.raises(InputError, match="negative size"):
            read_depth(tmp_path / "a.exr")


@pytest.mark.parametrize(
    ("key", "factor", "wanted"),
    [("depth", 1.0, 0.31), ("depth_z", 1.0, 0.20), ("depth", 0.2, 0.44), ("depth_z", 0.2, 0.44)],
)
def test_the_error_of_a_network_and_of_an_image(
    key: str, factor: float, wanted: float, walk: Walk, nothing: Measurements, tmp_path: Path
) -> None:
    """Images that agree have the prior deviation of 0.1 with a weight of three images."""
    for name, metres in maps_of(walk).items():
        np.savez(tmp_path / f"{Path(name).stem}.npz", **{key: metres * factor})  # type: ignore[arg-type]
    row = one(MetricDepth(tmp_path).observe(walk.scene, nothing))
    count = len(walk.scene.views)
    assert row.sd_log == pytest.approx(np.hypot(wanted, 0.1 * np.sqrt(3 / (count - 1 + 3) / count)), rel=0.02)


@pytest.mark.parametrize(("depth_m", "wanted"), [(1.01, 0.31), (0.99, 0.44)])
def test_a_scene_closer_than_a_metre_is_on_a_table(depth_m: float, wanted: float) -> None:
    assert network_sd({"", "mapanything"}, depth_m) == wanted


def test_the_scene_of_a_metric_network(walk: Walk, nothing: Measurements) -> None:
    """A cloud without sparse points has a depth, too."""
    cloud, made = DenseCloud(walk.scene.points), replace(walk.scene, network="CUT3R")
    for scene in (made, replace(made, points=np.empty((0, 3)), dense=cloud)):
        row = one(MetricDepth(None).observe(scene, nothing))
        assert (row.id, row.scale) == ("scene", 1.0)
        assert row.sd_log == pytest.approx(np.hypot(0.31, 0.1))


@pytest.mark.parametrize(
    ("network", "sd", "is_accepted"),
    [("CUT3R", None, True), ("ViPE", 0.2, True), ("Pi3", None, False), ("Pi3", 0.31, True), ("", None, False),
     ("", 0.2, True), ("VGGT", None, False), ("VGGT", 0.2, False)],
)  # fmt: skip
def test_only_metric_networks(
    network: str, sd: float | None, is_accepted: bool, walk: Walk, nothing: Measurements
) -> None:
    scene = replace(walk.scene, network=network, file_units=2.0)
    if is_accepted:
        assert one(MetricDepth(None, network_sd=sd).observe(scene, nothing)).scale == pytest.approx(2.0)
    else:
        found = "VGGT, whose units are normalised" if network == "VGGT" else network or "memory"
        with pytest.raises(InputError, match=rf"--metric-depth scene: expected .*\(CUT3R, ViPE\).*found {found}"):
            MetricDepth(None, network_sd=sd).observe(scene, nothing)


def test_maps_of_a_scene_without_sparse_points(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    for name, metres in maps_of(walk).items():
        np.save(tmp_path / f"{Path(name).stem}.npy", metres)
    scene = replace(walk.scene, points=np.empty((0, 3)), dense=DenseCloud(walk.scene.points))
    assert one(MetricDepth(tmp_path).observe(scene, nothing)).scale == pytest.approx(walk.scale, rel=0.02)


@pytest.mark.parametrize(("translation", "is_valid"), [([0.1, 0, 0], True), ([0, 0, 0], False), ([1.5e308] * 3, False)])
def test_a_baseline_of_a_rig_is_a_length_above_zero(translation: list[float], is_valid: bool, tmp_path: Path) -> None:
    moved = {"image_prefix": "b/", "cam_from_rig_translation": translation}
    rigs = [{"cameras": [{"image_prefix": "a/", "ref_sensor": True}, moved]}]
    (tmp_path / "rig_config.json").write_text(json.dumps(rigs), encoding="utf-8")
    with nullcontext() if is_valid else pytest.raises(InputError, match="a translation that is not 0"):
        assert rig_baselines(tmp_path / "rig_config.json")[0].metres == 0.1


@pytest.mark.parametrize(
    ("name", "files", "found"),
    [
        ("b.jpg", ["b.npy"], "b.npy"),
        ("a/b.jpg", ["a/b.npy", "b.npy"], "a/b.npy"),
        ("a/b.jpg", ["b.npy"], "b.npy"),
        ("a\\b.jpg", ["a/b.npy"], "a/b.npy"),
        ("b.jpg", ["b_depth.png", "b/depth.exr"], "b_depth.png"),
        ("b.jpg", ["b/depth.exr"], "b/depth.exr"),
        ("../b.jpg", ["b.npy"], "b.npy"),
        ("/x/b.jpg", ["b.npy"], "b.npy"),
        ("b.jpg", ["c.npy"], None),
    ],
)
def test_the_map_of_a_view(name: str, files: list[str], found: str | None, tmp_path: Path) -> None:
    for file in files:
        (tmp_path / "maps" / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "maps" / file).touch()
    (tmp_path / "b.npy").touch()  # outside of the folder
    assert depth_maps.map_file(tmp_path / "maps", name) == (None if found is None else tmp_path / "maps" / found)


def test_a_file_of_a_view_has_one_map(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    np.save(tmp_path / f"{Path(walk.scene.views[0].name).stem}.npy", np.ones((2, 4, 4)))
    with pytest.raises(InputError, match=r"shape: expected \(h, w\), one channel"):
        MetricDepth(tmp_path).observe(walk.scene, nothing)


ONE_PLACE = "both cameras are at one place"


@pytest.mark.parametrize(("distance", "reason"), [(0, ONE_PLACE), (1e-13, ONE_PLACE), (1e-11, None)])
def test_the_cameras_of_a_rig_are_at_two_places(
    walk: Walk, nothing: Measurements, distance: float, reason: str | None
) -> None:
    """The largest coordinate is 1; a distance of less than 1e-12 is a rounding error."""
    view = replace(walk.scene.views[0], rotation=np.eye(3))
    views = tuple(
        replace(view, name=f"{folder}/a.png", translation=-np.array([1.0, 0.2, 0.3 + apart]))
        for folder, apart in (("left", 0.0), ("right", distance))
    )
    row = one(RigBaseline("left", "right", RIG_M).observe(replace(walk.scene, views=views), nothing))
    assert (row.scale is None, row.reason) == (reason is not None, reason)


@pytest.mark.parametrize(
    ("text", "length"),
    [
        ("left:right:12cm", 0.12),
        ("left:right:0.12", 0.12),
        ("left:right:0", None),
        ("left:right:-1", None),
        ("left:right:inf", None),
        ("left:right", None),
        ("left:right:x", None),
    ],
)
def test_the_words_of_a_baseline(text: str, length: float | None) -> None:
    with nullcontext() if length else pytest.raises(InputError, match="A:B:DISTANCE"):
        (found,) = parse_rig_baselines(text)
        assert (found.first, found.second, found.metres) == ("left", "right", pytest.approx(length))


@pytest.mark.parametrize(
    ("second", "message"),
    [
        ({}, "three numbers at a camera of one rig or more"),
        ({"cam_from_rig_translation": [1, 2]}, "cam_from_rig_translation: expected 3 finite numbers"),
        ({"cam_from_rig_translation": [1, 2, "x"]}, "cam_from_rig_translation: expected 3 finite numbers"),
        ({"cam_from_rig_translation": [3, 0, 4]}, None),
        ({"image_prefix": "", "cam_from_rig_translation": [3, 0, 4]}, "an image_prefix each, and one ref_sensor"),
        ({"image_prefix": 7, "cam_from_rig_translation": [3, 0, 4]}, "an image_prefix each, and one ref_sensor"),
        ({"ref_sensor": True, "cam_from_rig_translation": [3, 0, 4]}, "an image_prefix each, and one ref_sensor"),
    ],
)
def test_cameras_of_a_rig_configuration(second: dict[str, Any], message: str | None, tmp_path: Path) -> None:
    cameras = [{"image_prefix": "a/", "ref_sensor": True}, {"image_prefix": "b/"} | second]
    (tmp_path / "rig_config.json").write_text(json.dumps([{"cameras": cameras}]), encoding="utf-8")
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        assert parse_rig_baselines(str(tmp_path / "rig_config.json")) == (RigBaseline("a/", "b/", 5.0),)
