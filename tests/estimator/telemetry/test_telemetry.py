"""Metadata tracks and logs: their content is read, damaged parts are omitted, and no input makes readers fail."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.telemetry.gpmf import Packet, gpmf_telemetry, keys
from estimator.telemetry.readers import camm_telemetry, is_camm, read_telemetry, subtitle_positions
from estimator.telemetry.records import Telemetry
from metric_base.errors import InputError
from tests.synthetic.telemetry import camm_packet, gpmf_key, gpmf_stream


def _gopro(first: int, start_us: int) -> bytes:
    """Four readings of the accelerometer and two positions."""
    readings = [[100 * (first + k), 200, 981] for k in range(4)]
    about = [gpmf_key("STMP", "J", [[start_us]]), gpmf_key("ORIN", "c", b"XzY"), gpmf_key("SCAL", "s", [[100]])]
    places = [[331267700 + k, -1173273436, -22959, 1, 2] for k in range(2)]
    scale = gpmf_key("SCAL", "l", [[10_000_000], [10_000_000], [1000], [1000], [100]])
    fix = [gpmf_key("GPSF", "L", [[3]]), gpmf_key("GPSP", "S", [[154]]), scale, gpmf_key("GPS5", "l", places)]
    return gpmf_stream([*about, gpmf_key("ACCL", "s", readings)], fix)


def test_a_gopro_track() -> None:
    packets = [Packet(0.0, 1.0, _gopro(0, 80_000)), Packet(1.0, 1.0, _gopro(4, 1_080_000))]
    telemetry = gpmf_telemetry(packets)
    assert telemetry.specific_force.times_s == pytest.approx(np.arange(8) / 4)
    assert telemetry.specific_force.values[5] == pytest.approx([5.0, 9.81, -2.0])  # the third channel is y, z turned
    assert telemetry.positions is not None
    assert telemetry.positions.positions[1] == pytest.approx([33.1267701, -117.3273436, -22.959])
    assert telemetry.positions.accuracy_m == pytest.approx(2.5 * 1.54)
    assert not len(telemetry.angular_rate)


def test_positions_without_a_fix_are_left_out() -> None:
    scale = gpmf_key("SCAL", "l", [[1], [1], [1], [1], [1]])
    lost = [gpmf_key("GPSF", "L", [[0]]), scale, gpmf_key("GPS5", "l", [[1, 2, 3, 4, 5]])]
    assert gpmf_telemetry([Packet(0.0, 1.0, gpmf_stream(lost))]).positions is None


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_damaged_gpmf_is_read_as_far_as_it_fits(data: st.DataObject) -> None:
    whole = bytearray(_gopro(0, 0))
    for _ in range(data.draw(st.integers(0, 6))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(whole[: data.draw(st.integers(0, len(whole)))])
    assert sum(8 + len(key.value) for key in keys(cut)) <= len(cut)
    telemetry = gpmf_telemetry([Packet(0.0, 1.0, cut), Packet(1.0, 1.0, _gopro(4, 1_000_000))])
    force = telemetry.specific_force
    assert np.isfinite(force.values).all()
    assert (np.diff(force.times_s) > 0).all()
    assert len(force) >= 4  # the whole packet


@settings(max_examples=80, deadline=None)
@given(st.binary(max_size=400))
def test_any_bytes(data: bytes) -> None:
    gpmf_telemetry([Packet(0.0, 1.0, data)])
    camm_telemetry([Packet(0.0, 1.0, data)])
    text = data.decode("latin-1")
    assert subtitle_positions(text) is None or "-->" in text


def test_a_camm_track() -> None:
    packets = [Packet(k / 100, 0.0, camm_packet(3, "3f", 1.0, 2.0, 9.5)) for k in range(3)]
    packets += [Packet(k / 100, 0.0, camm_packet(2, "3f", 0.1, 0.2, 0.3)) for k in range(3)]
    packets += [Packet(0.5, 0.0, camm_packet(6, "di2d7f", 0.0, 3, 48.1, 11.5, 520.0, 4.0, 8.0, 0, 0, 0, 0))]
    packets += [Packet(0.6, 0.0, camm_packet(6, "di2d7f", 0.0, 0, 0.0, 0.0, 0.0, 99.0, 8.0, 0, 0, 0, 0))]  # no fix
    telemetry = camm_telemetry(packets)
    assert telemetry.specific_force.values[2] == pytest.approx([1.0, 2.0, 9.5])
    assert telemetry.angular_rate.values[0] == pytest.approx([0.1, 0.2, 0.3])
    assert telemetry.positions is not None
    assert telemetry.positions.positions.tolist() == [[48.1, 11.5, 520.0]]
    assert telemetry.positions.accuracy_m == pytest.approx(4.0)
    assert not is_camm(b"\0\0\x03\0")


DJI = """1
00:00:00,000 --> 00:00:00,033
<font size="28">FrameCnt: 1 [latitude: 47.3764] [longitude: 8.5403] [rel_alt: 10.1 abs_alt: 418.5]</font>

2
00:00:01,500 --> 00:00:01,533
[latitude: 47.3765] [longtitude: 8.5404] [altitude: 419.0]

3
00:00:03,000 --> 00:00:03,033
[latitude: 0.000000] [longitude: 0.000000]

4
00:00:04,000 --> 00:00:05,000
F/2.8, SS 60, GPS (8.5405, 47.3766, 19), D 12.0m
"""


def test_the_subtitles_of_a_drone(tmp_path: Path) -> None:
    (tmp_path / "clip.srt").write_text(DJI)
    positions = read_telemetry(tmp_path / "clip.srt").positions
    assert positions is not None
    assert positions.times_s.tolist() == [0.0, 1.5, 4.0]
    assert positions.positions.tolist() == [[47.3764, 8.5403, 418.5], [47.3765, 8.5404, 419.0], [47.3766, 8.5405, 19.0]]


def test_logs(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(
        "time_s,ax,ay,az,gx,gy,gz\n0.02,1,2,9,.1,.2,.3\n0.01,1,2,8,.1,.2,.4\n0.03,1,2,7,,,\n"
    )
    log = read_telemetry(tmp_path / "log.csv")
    assert log.specific_force.values[:, 2].tolist() == [8.0, 9.0, 7.0]
    assert log.angular_rate.times_s.tolist() == [0.01, 0.02]
    (tmp_path / "metadata.json").write_text(json.dumps({"fps": 60, "poses": [[0, 0, 0, 1, 1, 2, 3]] * 3}))
    path = read_telemetry(tmp_path / "metadata.json").path
    assert path is not None
    assert path.times_s.tolist() == [0.0, 1 / 60, 2 / 60]
    assert path.positions[2].tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("log.csv", "time_s,ax,ay\n0,1,2\n"),
        ("log.csv", "time_s,ax,ay,az\n0,1,2,x\n"),
        ("log.csv", "time_s,ax,ay,az\n0,1,2,nan\n"),
        ("log.csv", "time_s,ax,ay,az\n0,1,2,x,5,6\n"),
        ("metadata.json", '{"fps": 60, "poses": [[1, 2]]}'),
        ("metadata.json", '{"fps": 0, "poses": [[0, 0, 0, 1, 1, 2, 3]]}'),
        ("metadata.json", "[]"),
        ("metadata.json", f'{{"fps": 60, "poses": [[0, 0, 0, 1, 1, 2, {"9" * 400}]]}}'),
    ],
)
def test_a_damaged_log_is_one_line(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=name):
        read_telemetry(tmp_path / name)


def test_the_poses_of_a_telephones_own_tracking_are_a_path_in_metres(tmp_path: Path) -> None:
    """The clock is the telephone's, and ran before."""
    rows = [(8021.5 + k / 60, k, 0.1 * k, 1.0, -0.2 * k, 0, 0, 0, 1) for k in range(5)]
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw", *(", ".join(map(str, row)) for row in rows)]
    (tmp_path / "odometry.csv").write_text("\n".join(lines) + "\n")
    log = read_telemetry(tmp_path / "odometry.csv")
    assert log.path is not None
    assert not log.path.geodetic
    np.testing.assert_allclose(log.path.times_s, np.arange(5) / 60, atol=1e-9)
    np.testing.assert_allclose(log.path.positions[3], [0.3, 1.0, -0.6])


@pytest.mark.parametrize(("fix", "n_fixes"), [(1, 0), (2, 1)])
def test_a_fix_of_camm_is_at_least_a_position(fix: int, n_fixes: int) -> None:
    packet = Packet(0.5, 0.0, camm_packet(6, "di2d7f", 0.0, fix, 48.1, 11.5, 520.0, 4.0, 8.0, 0, 0, 0, 0))
    positions = camm_telemetry([packet]).positions
    assert (0 if positions is None else len(positions.times_s)) == n_fixes


class _Track:
    """A container of PyAV with one metadata track of CAMM, whose packets state these sizes in bytes."""

    def __init__(self, sizes: list[int]) -> None:
        self.streams = [SimpleNamespace(type="data", index=0)]
        self._sizes = sizes

    def __enter__(self) -> _Track:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def demux(self, _: object) -> Iterator[_SizedPacket]:
        return (_SizedPacket(pts, size) for pts, size in enumerate(self._sizes))


class _SizedPacket:
    time_base, duration, stream_index = 0.001, 1, 0

    def __init__(self, pts: int, size: int) -> None:
        self.pts, self.size = pts, size

    def __bytes__(self) -> bytes:
        return camm_packet(3, "3f", 1.0, 2.0, 9.5)


@pytest.mark.parametrize(("last", "n_read"), [(0, 3), (1, 2)])
def test_metadata_tracks_are_read_up_to_256_mebibytes(
    last: int, n_read: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes = [1 << 27, (1 << 27) - 1, 1 + last]
    monkeypatch.setattr(av, "open", lambda *_, **__: _Track(sizes))
    (tmp_path / "a.mp4").touch()
    assert len(read_telemetry(tmp_path / "a.mp4").specific_force) == n_read


def _read(*keys_: bytes) -> Telemetry:
    return gpmf_telemetry([Packet(0.0, 1.0, gpmf_stream(list(keys_)))])


ACCL = [[100, 200, 981], [101, 201, 980]]


@pytest.mark.parametrize(
    ("other", "first"),
    [
        (gpmf_key("SCAL", "s", [[100]]), [1.0, 2.0, 9.81]),
        (gpmf_key("SCAL", "s", [[100], [50], [1]]), [1.0, 4.0, 981.0]),
        (gpmf_key("SCAL", "s", [[100], [50]]), [100.0, 200.0, 981.0]),  # of two numbers for three
        (gpmf_key("SCAL", "s", [[0]]), [100.0, 200.0, 981.0]),
        (gpmf_key("SCAL", "c", b"ab"), [100.0, 200.0, 981.0]),  # no numbers
        (gpmf_key("ORIN", "c", b"zYX"), [981.0, 200.0, -100.0]),
        (gpmf_key("ORIN", "c", b"XYY"), [100.0, 200.0, 981.0]),  # no three axes
        (gpmf_key("ORIN", "c", b"XY"), [100.0, 200.0, 981.0]),
    ],
)
def test_scale_and_axes_of_a_sensor_are_used_if_they_fit(other: bytes, first: list[float]) -> None:
    assert _read(other, gpmf_key("ACCL", "s", ACCL)).specific_force.values[0] == pytest.approx(first)


@pytest.mark.parametrize("key", [gpmf_key("ACCL", "s", [[1, 2]]), gpmf_key("ACCL", "c", b"abcdef")])
def test_a_sensor_without_three_numbers_is_omitted(key: bytes) -> None:
    assert not len(_read(key).specific_force)


@pytest.mark.parametrize(
    ("name", "rows", "position"),
    [
        ("GPS5", [[48, 11, 500, 1, 2]], [48, 11, 500]),
        ("GPS5", [[48, 11, 500, 1]], None),
        ("GPS9", [[48, 11, 500, 1, 2, 3, 4, 5, 3]], [48, 11, 500]),
        ("GPS9", [[48, 11, 500, 1, 2, 3, 4, 5, 2]], [48, 11, 500]),
        ("GPS9", [[48, 11, 500, 1, 2, 3, 4, 5, 1]], None),
        ("GPS9", [[48, 11, 500, 1, 2, 3, 4, 5]], None),
        ("GPRI", [[9, 48, 11, 500, 1, 1, 1, 1, 3, 8]], [48, 11, 500]),
        ("GPRI", [[9, 48, 11, 500, 1, 1, 1, 1, 1, 8]], None),
        ("GPRI", [[9, 48, 11, 500, 1, 1, 1, 1, 3]], None),
    ],
)
def test_a_position_needs_its_columns_and_a_fix(name: str, rows: list[list[int]], position: list[float] | None) -> None:
    positions = _read(gpmf_key(name, "l", rows)).positions
    found = None if positions is None or not len(positions.positions) else positions.positions[0].tolist()
    assert found == position


@pytest.mark.parametrize(("precision", "accuracy_m"), [([[154]], 2.5 * 1.54), (None, None)])
def test_the_accuracy_of_positions_is_that_of_their_dilution(
    precision: list[list[int]] | None, accuracy_m: float | None
) -> None:
    stated = [] if precision is None else [gpmf_key("GPSP", "S", precision)]
    positions = _read(*stated, gpmf_key("GPS5", "l", [[48, 11, 500, 1, 2]])).positions
    assert positions is not None
    assert positions.accuracy_m == (None if accuracy_m is None else pytest.approx(accuracy_m))


@pytest.mark.parametrize(("depth", "is_read"), [(7, True), (8, False)])
def test_streams_are_read_in_up_to_eight_other_keys(depth: int, is_read: bool) -> None:
    data = gpmf_stream([gpmf_key("ACCL", "s", ACCL)])
    for _ in range(depth):
        data = gpmf_key("DEVC", "", data)
    assert bool(len(gpmf_telemetry([Packet(0.0, 1.0, data)]).specific_force)) == is_read


@pytest.mark.parametrize(("kinds", "n_readings"), [(b"sss", 2), (b"sxs", 0), (b"ssl", 0), (b"", 0)])
def test_readings_of_several_types_have_the_types_of_their_stream(kinds: bytes, n_readings: int) -> None:
    """Two readings of three numbers of 16 bits; `x` is no type, and `l` has 32 bits."""
    readings = gpmf_key("ACCL", "?", b"".join(int(value).to_bytes(2, "big") for value in range(6)))
    readings = readings[:5] + bytes([6]) + (2).to_bytes(2, "big") + readings[8:]
    stream = gpmf_stream([gpmf_key("TYPE", "c", kinds), readings])
    assert len(gpmf_telemetry([Packet(0.0, 1.0, stream)]).specific_force) == n_readings


def test_fixed_point_columns_are_divided_in_readings_of_several_types() -> None:
    values = b"".join(value.to_bytes(size, "big") for value, size in ((1, 2), (5 << 15, 4), (3, 2)))
    readings = b"ACCL?" + bytes([8]) + (1).to_bytes(2, "big") + values
    stream = gpmf_stream([gpmf_key("TYPE", "c", b"sqs"), readings])
    assert gpmf_telemetry([Packet(0.0, 1.0, stream)]).specific_force.values.tolist() == [[1, 2.5, 3]]


@pytest.mark.parametrize(
    ("text", "positions"),
    [
        ("[latitude: 47.5] [longitude: 8.5] [altitude: 400]", [[47.5, 8.5, 400]]),
        ("[latitude: 47.5] [longtitude: 8.5] [abs_alt: 410 altitude: 400]", [[47.5, 8.5, 410]]),
        ("[latitude: 47.5] [longitude: 8.5]", [[47.5, 8.5, 0]]),
        ("[latitude: 47.5]", None),
        ("[longitude: 8.5]", None),
        ("[latitude: 0] [longitude: 0]", None),
        ("[latitude: 0] [longitude: 8.5]", [[0, 8.5, 0]]),
    ],
)
def test_a_subtitle_has_a_latitude_and_a_longitude(text: str, positions: list[list[float]] | None) -> None:
    found = subtitle_positions(f"1\n00:00:01,000 --> 00:00:02,000\n{text}\n")
    assert (None if found is None else found.positions.tolist()) == positions


@pytest.mark.parametrize("name", ["a.mp4", "a.srt", "a.csv", "a.json"])
def test_a_recording_is_a_file(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="file: expected a video or a log, found no such file"):
        read_telemetry(tmp_path / name)
