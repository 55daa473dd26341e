"""Positions of the cameras: GPS, tables, EXIF, and their alignment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from capture.recorded_sources import recorded_sources
from estimator.evidence import gps
from estimator.evidence.alignment import align
from estimator.evidence.gps import Gps, east_north_up, path_speed, position_evidence, stretch_ratio, taken_as_metres
from estimator.evidence.markers import Marker
from estimator.geometry.vertical import OBSERVED_METHODS
from estimator.records.objects import MeasuredObject, Measurements, Up
from estimator.records.options import EstimateOptions
from estimator.records.result import ScaleEvidence
from estimator.results.estimate import scale_of_objects
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_tree.tree import Tree
from tests.synthetic.evidence import degrees_of, one, position_table, write_exif
from tests.synthetic.walk import Walk


def test_positions_in_metres(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    noisy = walk.metres + np.random.default_rng(1).normal(0, 0.02, walk.metres.shape)
    noisy[:3] += 40  # three positions in the next street
    row = one(Gps(position_table(tmp_path / "path.csv", walk.scene, noisy, "x y z")).observe(walk.scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=0.01)
    assert row.sd_log == pytest.approx(0.01, abs=0.004)


def test_positions_in_degrees(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    file = position_table(tmp_path / "path.csv", walk.scene, degrees_of(walk.metres), "lat lon alt")
    assert one(Gps(file).observe(walk.scene, nothing)).scale == pytest.approx(walk.scale, rel=0.006)


@pytest.mark.parametrize(("latitude", "longitude", "place"), [(55.7, 13.2, "SE"), (55.7, 12.6, None)])
def test_the_country_of_positions(
    walk: Walk, nothing: Measurements, tmp_path: Path, latitude: float, longitude: float, place: str | None
) -> None:
    degrees = degrees_of(walk.metres, latitude, longitude)
    table = position_table(tmp_path / "path.csv", walk.scene, degrees, "lat lon alt")
    assert one(Gps(table).observe(walk.scene, nothing)).place == place
    here = replace(walk, scene=replace(walk.scene, path=tmp_path))
    write_exif(here, place=(latitude, longitude))
    assert one(Gps("exif").observe(here.scene, nothing)).place == place
    metres = position_table(tmp_path / "metres.csv", walk.scene, walk.metres, "x y z")
    assert one(Gps(metres).observe(walk.scene, nothing)).place is None


def test_the_unit_of_positions_is_stated_as_an_assumption(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    """Web Mercator at 48 degrees north multiplies lengths by 1.494; coordinates up to 100 km are local."""
    for offset, words in (
        ([0, 0, 0], "taken as metres"),
        ([99e3, 0, 0], "taken as metres"),
        ([1_224_514, 6_106_855, 0], "taken as metres; in Web Mercator the scale would be 1.49 times too large"),
        ([4_176_000, 857_000, 4_727_000], "taken as metres"),  # geocentric
    ):
        file = position_table(tmp_path / "path.csv", walk.scene, walk.metres + offset, "x y z")
        assert one(Gps(file).observe(walk.scene, nothing)).assumption == words
    file = position_table(tmp_path / "path.csv", walk.scene, degrees_of(walk.metres), "lat lon alt")
    assert one(Gps(file).observe(walk.scene, nothing)).assumption == "taken as decimal degrees and metres"


def test_positions_too_rough_for_their_path_are_mute(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    rough = walk.metres + np.random.default_rng(1).normal(0, 4.0, walk.metres.shape)
    row = one(Gps(position_table(tmp_path / "path.csv", walk.scene, rough, "x y z")).observe(walk.scene, nothing))
    assert row.scale is None
    assert row.reason is not None
    few = position_table(
        tmp_path / "few.csv", replace(walk.scene, views=walk.scene.views[:3]), walk.metres[:3], "x y z"
    )
    assert "3 views have a position" in str(one(Gps(few).observe(walk.scene, nothing)).reason)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda places: places[:, [1, 0, 2]], "stretched"),
        (lambda places: places[0] + [1, 1.5, 1] * (places - places[0]), "stretched by 1.5"),
        (lambda places: places[0] + [1, 1.15, 1] * (places - places[0]), "stretched by 1.1"),
        (lambda places: places * [1, -1, 1], "their up is"),
    ],
)
def test_positions_that_are_stretched_or_mirrored_are_left_out(
    walk: Walk, nothing: Measurements, tmp_path: Path, change: Callable[[FloatArray], FloatArray], reason: str
) -> None:
    noisy = walk.metres + np.random.default_rng(1).normal(0, 0.02, walk.metres.shape)
    file = position_table(tmp_path / "path.csv", walk.scene, change(degrees_of(noisy)), "lat lon alt")
    row = one(Gps(file).observe(walk.scene, nothing))
    assert row.scale is None
    assert reason in str(row.reason)


def test_a_receiver_that_drifts_along_a_straight_walk_says_nothing_of_up() -> None:
    """Any rotation about the line fits: distances from the line are the drift of the receiver."""
    along = np.linspace(0, 14, 180)
    cameras = np.column_stack([along, 0.04 * np.sin(along), 0.01 * np.cos(3 * along)]) / 1.1
    drift = np.column_stack([0.3 * np.sin(along / 5), 0.08 * np.sin(along / 3), -0.08 * np.sin(along / 4)])
    up = Up(np.array([0.0, 0.0, -1.0]), OBSERVED_METHODS[0], 0.7)  # the other way round, by the positions
    row = one(position_evidence("gps_video", "walk", cameras, 1.1 * cameras + drift, 5.0, up))
    assert row.scale == pytest.approx(1.1, rel=0.05)
    wide = np.column_stack([cameras[:, 0], np.cos(along), 0.2 * np.sin(3 * along)])
    exact = position_evidence("gps", "table", wide, 1.1 * wide, None, up)
    assert "their up is 180" in str(one(exact).reason)


def test_a_latitude_beyond_the_pole_is_refused(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    file = position_table(tmp_path / "path.csv", walk.scene, np.add(walk.metres, [127.0, 37.0, 0.0]), "lat lon alt")
    with pytest.raises(InputError, match="is it the longitude"):
        Gps(file).observe(walk.scene, nothing)


@pytest.mark.parametrize(
    "text", ["", "name,x,y\n", "name,x,y,z\nleft/0000.png,1,2\n", "name,x,y,z\nleft/0000.png,1,2,nan\n"]
)
def test_a_damaged_table_is_one_line(walk: Walk, nothing: Measurements, tmp_path: Path, text: str) -> None:
    (tmp_path / "path.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"path\.csv"):
        Gps(tmp_path / "path.csv").observe(walk.scene, nothing)


def test_pictures_in_a_folder_of_another_name(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    write_exif(walk)
    (tmp_path / "images").rename(tmp_path / "pictures")
    assert one(Gps("exif").observe(walk.scene, nothing)).scale is None
    assert one(Gps("exif", tmp_path / "pictures").observe(walk.scene, nothing)).scale is not None
    marker = Marker("DICT_4X4_50", 0.1, images=tmp_path / "pictures")
    assert one(marker.observe(walk.scene, nothing)).reason == "no marker is in two or more images"


@pytest.mark.parametrize(("factor", "is_skipped"), [(1.0, False), (0.95, False), (1.05, True)])
def test_positions_of_photographs_are_not_faster_than_aeroplanes(
    walk: Walk, nothing: Measurements, tmp_path: Path, factor: float, is_skipped: bool
) -> None:
    """The times of EXIF are in whole seconds: positions in millimetres are thousands of metres apart."""
    write_exif(walk, seconds=2)
    times = 2.0 * np.arange(len(walk.metres))
    metres = walk.metres if factor == 1.0 else walk.metres * factor * 350.0 / path_speed(times, walk.metres)
    file = position_table(tmp_path / "path.csv", walk.scene, metres, "x y z")
    row = one(Gps(file).observe(walk.scene, nothing))
    assert (row.scale is None) == is_skipped
    assert not is_skipped or "faster than aeroplanes" in str(row.reason)
    assert row.assumption == (None if is_skipped else "taken as metres")


def test_a_path_over_the_date_line_is_short() -> None:
    metres = east_north_up(np.array([[10.0, 179.9999, 0.0], [10.0, -179.9999, 5.0]]))
    assert np.linalg.norm(metres[1]) == pytest.approx(22.4, abs=0.6)


@given(st.floats(0.01, 100), st.integers(0, 1000), st.integers(3, 30))
@settings(max_examples=40)
def test_alignment_finds_the_scale(scale: float, seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    source = generator.standard_normal((count, 3))
    turn, _ = np.linalg.qr(generator.standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    alignment = align(source, scale * source @ turn.T + generator.uniform(-9, 9, 3))
    assert alignment is not None
    assert alignment.scale == pytest.approx(scale, rel=1e-6)


def test_points_at_one_place_align_with_nothing() -> None:
    assert align(np.zeros((5, 3)), np.ones((5, 3))) is None
    assert align(np.eye(3)[:2], np.eye(3)[:2]) is None


@pytest.mark.filterwarnings("error")
def test_damaged_exif_is_quiet(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    here = replace(walk, scene=replace(walk.scene, path=tmp_path))
    write_exif(here)
    for number, file in enumerate(sorted((tmp_path / "images").rglob("*.*"))):
        data = bytearray(file.read_bytes())
        start = data.index(b"Exif") if b"Exif" in data else data.index(b"eXIf")
        data[start + 8 + number : start + 60] = b"\xff" * (52 - number)
        file.write_bytes(data)
    assert one(Gps("exif").observe(here.scene, nothing)).scale is None


def test_photographs_of_200_megapixels_have_positions(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    here = replace(walk, scene=replace(walk.scene, path=tmp_path))
    write_exif(here)
    large, damaged = sorted((tmp_path / "images").rglob("*.*"))[:2]
    with Image.open(large) as image:
        exif = image.getexif()
        exif[0x8825] = exif.get_ifd(0x8825)
        Image.new("1", (20_000, 10_000)).save(large, "PNG", exif=exif)
        exif[0x8825][2] = (1.0,) * 200
        Image.new("1", (8, 6)).save(damaged, "PNG", exif=exif)
    positions, _ = gps.exif_positions(here.scene, None)
    assert set(range(len(here.scene.views))) - set(positions) == {1}
    assert one(Gps("exif").observe(here.scene, nothing)).scale == pytest.approx(walk.scale, rel=0.01)


def test_no_position_is_outside_the_earth(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    file = position_table(tmp_path / "path.csv", walk.scene, walk.metres + 1e300, "x y z")
    with pytest.raises(InputError, match="finite numbers below 1e\\+09"):
        Gps(file).observe(walk.scene, nothing)


def _earth_centred(degrees: np.ndarray) -> np.ndarray:
    """(n, 3) metres of WGS 84 positions, by the ellipsoid's equation."""
    lat, lon, height = np.radians(degrees[:, 0]), np.radians(degrees[:, 1]), degrees[:, 2]
    square = 0.00669437999014
    prime = 6378137.0 / np.sqrt(1 - square * np.sin(lat) ** 2)
    along = (prime + height) * np.cos(lat)
    return np.column_stack([along * np.cos(lon), along * np.sin(lon), (prime * (1 - square) + height) * np.sin(lat)])


@given(st.floats(-70, 70), st.floats(-180, 180), st.floats(-300, 3000))
def test_east_north_up_is_those_of_the_ellipsoid(lat: float, lon: float, height: float) -> None:
    places = np.array([[lat, lon, height], [lat + 0.005, lon, height], [lat, lon + 0.005, height + 7]])
    found, exact = east_north_up(places), _earth_centred(places)
    assert np.linalg.norm(found[1:], axis=1) == pytest.approx(np.linalg.norm(exact[1:] - exact[0], axis=1), rel=2e-4)


def test_pictures_all_over_the_scene_are_asked_for_gps(walk: Walk, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(gps, "exif_positions", lambda scene, _: asked.extend(scene.views) or ({}, 0.0))
    views = tuple(replace(walk.scene.views[0], name=str(number)) for number in range(40))
    assert not gps.images_have_gps(replace(walk.scene, views=views), None)
    assert [int(view.name) for view in asked] == [0, 8, 16, 24, 32]


def test_gps_of_photographs_is_used_unasked_and_may_be_switched_off(walk: Walk, tmp_path: Path) -> None:
    here = replace(walk, scene=replace(walk.scene, path=tmp_path))
    assert recorded_sources(tmp_path, here.scene) == ()  # no image has a position
    write_exif(here)
    assert recorded_sources(tmp_path, here.scene) == (Gps("exif", None),)
    assert recorded_sources(tmp_path, here.scene, gps="none") == ()


@pytest.mark.parametrize(("stretch", "is_used"), [(1.05, True), (1.07, False)])
def test_positions_are_stretched_from_six_percent(walk: Walk, stretch: float, is_used: bool) -> None:
    centres = np.array([view.centre for view in walk.scene.views])
    metres = walk.metres * [1, stretch, 1]
    row = one(position_evidence("gps", "table", centres, metres, None, None))
    assert (row.scale is not None) == is_used
    assert is_used or "stretched by 1.0" in str(row.reason)


@pytest.mark.parametrize(("sd_log", "is_used"), [(0.19, True), (0.21, False)])
def test_positions_of_a_receiver_have_an_error_under_a_fifth(walk: Walk, sd_log: float, is_used: bool) -> None:
    """The error of the length is 0.41 of the drift, a tenth of the accuracy, relative to the extent; 0.01 at least."""
    centres = np.array([view.centre for view in walk.scene.views])
    alignment = align(centres, walk.metres)
    assert alignment is not None
    accuracy = np.sqrt(sd_log**2 - 0.01**2) * alignment.extent / (0.41 * 0.1)
    row = one(position_evidence("gps", "exif", centres, walk.metres, float(accuracy), None))
    assert (row.scale is not None) == is_used
    if is_used:
        assert row.sd_log == pytest.approx(sd_log, rel=1e-3)


@pytest.mark.parametrize(("n_views", "is_used"), [(3, False), (4, True)])
def test_four_positions_give_a_scale(
    walk: Walk, nothing: Measurements, tmp_path: Path, n_views: int, is_used: bool
) -> None:
    chosen = np.linspace(0, len(walk.scene.views) - 1, n_views).astype(int)
    scene = replace(walk.scene, views=tuple(walk.scene.views[row] for row in chosen))
    file = position_table(tmp_path / "path.csv", scene, walk.metres[chosen], "x y z")
    assert (one(Gps(file).observe(scene, nothing)).scale is not None) == is_used


@pytest.mark.parametrize(
    ("columns", "first", "words"),
    [
        ("lat lon alt", 90.1, "degrees from -90 to 90"),
        ("lat lon alt", 89.9, None),
        ("x y z", 1.01e9, "finite numbers below 1e"),
        ("x y z", 0.99e9, None),
    ],
)
def test_a_latitude_is_at_most_90_degrees_and_a_coordinate_a_million_kilometres(
    walk: Walk, nothing: Measurements, tmp_path: Path, columns: str, first: float, words: str | None
) -> None:
    rows = walk.metres.copy() if columns == "x y z" else degrees_of(walk.metres)
    rows[0, 0] = first
    file = position_table(tmp_path / "path.csv", walk.scene, rows, columns)
    if words is None:
        assert Gps(file).observe(walk.scene, nothing)
    else:
        with pytest.raises(InputError, match=words):
            Gps(file).observe(walk.scene, nothing)


def test_an_assumption_is_reported_if_no_object_confirms_it(mini: Tree) -> None:
    positions = ScaleEvidence("gps", "path.csv", 0.5, 0.02, assumption="taken as metres")
    alone = scale_of_objects([], mini, EstimateOptions(evidence=(positions,)))
    assert (alone.evidence[0].verdict, alone.evidence[0].reason) == ("used", "taken as metres")
    chair = MeasuredObject("1", "swivel chair", np.array([1.24, 1.20, 2.10]), np.full(3, 0.03))
    confirmed = scale_of_objects([chair], mini, EstimateOptions(evidence=(positions,)))
    assert (confirmed.evidence[0].verdict, confirmed.evidence[0].reason) == ("used", None)


@pytest.mark.parametrize(
    ("position", "is_projected"),
    [
        ([9.5e4, 5.0, 0], False),  # MAX_LOCAL_M of 100 km
        ([1.05e5, 5.0, 0], True),
        ([5.0, -1.05e5, 0], True),
        ([5.0, 5.0, 1.05e5], False),  # a height
        ([2e5, 2.00e7, 0], True),  # the map ends at pi R = 20,037.5 km
        ([2e5, 2.01e7, 0], False),
        ([0, 1.009 * 6_378_137, 0], False),  # geocentric within MAX_GEOCENTRIC_DEVIATION of 1 %
        ([0, 1.011 * 6_378_137, 0], True),
        ([0, 0.991 * 6_378_137, 0], False),
        ([0, 0.989 * 6_378_137, 0], True),
    ],
)
def test_which_coordinates_are_those_of_a_map(position: list[float], is_projected: bool) -> None:
    assert ("Web Mercator" in taken_as_metres([np.array(position, dtype=float)])) == is_projected


@pytest.mark.parametrize(("seconds", "speed"), [(0.0, 0.0), (0.9, 0.0), (1.0, 3.0), (1.5, 3.0), (5.0, 3.0)])
def test_the_speed_of_a_path_is_that_over_a_second(seconds: float, speed: float) -> None:
    """SPEED_LAG_S: every other position is a metre off, which would be 10 m/s between neighbours."""
    times = np.arange(round(seconds * 10) + 1) / 10
    metres = np.column_stack([3 * times, np.arange(len(times)) % 2, 0 * times])
    assert path_speed(times, metres) == pytest.approx(speed)
    assert path_speed(times[:0], metres[:0]) == 0


@pytest.mark.parametrize(
    ("width", "error", "residual", "is_stretched"),
    [
        (0.12, 0.0, 0.01, True),  # MIN_DIRECTION_EXTENT of 0.1 of the length
        (0.08, 0.0, 0.01, False),
        (0.5, 0.01, 0.023, True),  # the linear map leaves less than MAX_STRETCHED_RESIDUAL, half, of the residual
        (0.5, 0.01, 0.017, False),
    ],
)
def test_a_stretch_needs_a_wide_path_that_a_linear_map_fits(
    width: float, error: float, residual: float, is_stretched: bool
) -> None:
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    centres = np.column_stack([np.cos(angle), width * np.sin(angle), 0 * angle])
    metres = centres * [1, 1.2, 1] + error * np.sqrt(2) * np.column_stack([np.cos(k * angle) for k in (5, 7, 9)])
    assert (stretch_ratio(centres, metres, residual) is not None) == is_stretched
    assert stretch_ratio(centres, centres * [1, 1, 1] + error, residual) is None


@pytest.mark.parametrize(
    ("tags", "metres"),
    [
        ({}, 5.0),
        ({0x1F: 3.0, 0x0B: 2.0}, 3.0),  # the error is stated
        ({0x0B: 2.0}, 5.0),
        ({0x0B: 4.0}, 10.0),  # 2.5 m a unit of dilution
        ({0x1F: 0.0, 0x0B: 4.0}, 10.0),
        ({0x1F: -3.0}, 5.0),
        ({0x1F: 0.95e9}, 0.95e9),
        ({0x1F: 1.05e9}, 5.0),  # MAX_COORDINATE
    ],
)
def test_the_error_of_a_position(tags: dict[int, float], metres: float) -> None:
    assert gps.exif_accuracy(tags) == metres


@pytest.mark.parametrize(
    ("changes", "position"),
    [
        ({}, [48.5, 11.25, 500.0]),
        ({1: "S"}, [-48.5, 11.25, 500.0]),
        ({3: "W"}, [48.5, -11.25, 500.0]),
        ({5: 1}, [48.5, 11.25, -500.0]),
        ({5: b"\x01"}, [48.5, 11.25, -500.0]),
        ({5: 0}, [48.5, 11.25, 500.0]),
        ({6: 0.95e9}, [48.5, 11.25, 0.95e9]),
        ({6: 1.05e9}, None),
        ({2: None}, None),
        ({4: None}, None),
        ({6: None}, [48.5, 11.25, 0.0]),
    ],
)
def test_a_position_has_its_references(changes: dict[int, Any], position: list[float] | None) -> None:
    tags = {1: "N", 2: (48, 30, 0), 3: "E", 4: (11, 15, 0), 5: b"\x00", 6: 500.0} | changes
    found = gps.exif_position({tag: value for tag, value in tags.items() if value is not None})
    assert found == (None if position is None else pytest.approx(position))
