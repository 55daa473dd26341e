"""Conditions of frames in numbers: ranges, images of a reconstruction, formats and ranges of videos, depth images."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from capture.frame_poses import FILE_NAME, FramePose, FramePoses, write_frame_poses
from capture.sources.video import Video
from estimator.records.scene import Camera, Scene, View
from insertion.composite.compose import ObjectComposite
from insertion.exports.export_folder import LayerWriter
from insertion.exports.metric_frame import CameraKeyframe
from insertion.exports.nerfstudio import write_transforms
from insertion.footage.footage import Footage, Frame, ImageSequence, SceneImages, video_footage
from insertion.footage.image_writer import output_kind
from insertion.footage.video_writer import VideoWriter, changed_frame, matrix_of
from insertion.render.layers import ObjectLayers
from insertion.render.renderer import ObjectImage
from insertion.scene.pixel_box import PixelBox
from metric_base.errors import InputError

CAMERA = Camera("PINHOLE", 12, 8, np.array([10.0, 10, 6, 4]))


def scene(folder: Path, *names: str) -> Scene:
    views = [
        View(name, CAMERA, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, dtype=np.int64)) for name in names
    ]
    return Scene(folder, "colmap", tuple(views), np.empty((0, 3)))


class Numbered(Footage):
    """Five frames, which counts those that are read."""

    def __init__(self) -> None:
        self.frames = tuple(Frame(k, f"{k}.png", None, None, None) for k in range(5))
        self.n_read = 0

    def __iter__(self) -> Iterator[tuple[Frame, NDArray[np.uint8]]]:
        for frame in self.frames:
            self.n_read += 1
            yield frame, np.full((1, 1, 3), frame.index, np.uint8)


@pytest.mark.parametrize(("first", "last", "indices"), [(0, 0, [0]), (1, 3, [1, 2, 3]), (4, 9, [4])])
def test_a_range_of_frames_is_read_to_its_last_one(first: int, last: int, indices: list[int]) -> None:
    footage = Numbered()
    part = footage.between(first, last)
    assert [(frame.index, int(image[0, 0, 0])) for frame, image in part] == [(k, k) for k in indices]
    assert footage.n_read == min(last + 2, 5)
    assert part.start_s == footage.start_s


def test_a_range_beyond_the_frames_is_refused() -> None:
    with pytest.raises(InputError, match="--frames: expected numbers from 0 to 4; found 5:9"):
        Numbered().between(5, 9)


def test_images_of_a_scene_have_the_size_of_their_camera(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    found = scene(tmp_path, "b.png", "a.png", "absent.png")
    with pytest.raises(InputError, match=r"expected the images of its views .--images DIR.; found none in"):
        SceneImages(found, folder)
    cv2.imwrite(str(folder / "a.png"), np.full((8, 12, 3), (1, 2, 3), np.uint8))
    cv2.imwrite(str(folder / "b.png"), np.zeros((8, 13, 3), np.uint8))
    images = SceneImages(found, folder)
    assert images.rows == (0, 1)
    assert images.image(1)[0, 0].tolist() == [3, 2, 1]  # red, green, blue
    assert [frame.name for frame in ImageSequence(images).frames] == ["a.png", "b.png"]
    with pytest.raises(InputError, match=r"b.png: size: expected 12 x 8, as its camera; found 13 x 8"):
        images.image(0)
    (folder / "a.png").write_bytes(b"no image")
    images = SceneImages(found, folder)  # another one, because decoded images are kept
    with pytest.raises(InputError, match=r"a.png: not an image"):
        images.image(1)


def test_a_work_folder_of_a_video_has_its_frames(tmp_path: Path) -> None:
    video, found = tmp_path / "walk.mp4", scene(tmp_path, "000000.png")
    assert video_footage(tmp_path, found) is None
    posed = FramePose(0, 0.0, "000000.jpg", "reconstructed", np.eye(3), np.zeros(3))
    poses = FramePoses(video, CAMERA, 0, (posed, FramePose(1, 0.5, None, "none")))
    write_frame_poses(replace(poses, source=tmp_path / "images"), tmp_path / FILE_NAME)
    assert video_footage(tmp_path, found) is None
    write_frame_poses(poses, tmp_path / FILE_NAME)
    with pytest.raises(InputError, match=r"source: expected the video .*walk.mp4; the file does not exist"):
        video_footage(tmp_path, found)
    with VideoWriter(video, ".mp4") as writer:
        for k in range(3):
            writer.write(np.zeros((8, 12, 3), np.uint8), k / 2)
    footage = video_footage(tmp_path, found)
    assert footage is not None
    assert [(frame.row, frame.view is not None, frame.clock_s) for frame in footage.frames] == [
        (0, True, 0.0),
        (None, False, 0.5),
    ]
    assert [frame.index for frame, _ in footage] == [0, 1]  # the video has a third one


@pytest.mark.parametrize(("name", "kind"), [("a.mp4", "video"), ("a.MKV", "video"), ("a", "folder")])
def test_the_suffix_of_an_output_decides(name: str, kind: str, tmp_path: Path) -> None:
    assert output_kind(tmp_path / name) == kind
    with pytest.raises(InputError, match="--out: expected a folder or a video"):
        output_kind(tmp_path / "a.xyz")
    with pytest.raises(InputError, match="--out: expected a file in an existing folder"):
        output_kind(tmp_path / "absent" / "a.mp4")


def grey(pixel_format: str, level: int = 100, size: tuple[int, int] = (16, 8), color_range: int = 1) -> Any:
    """A frame of one level in all planes, BT.709."""
    frame = av.VideoFrame(*size, pixel_format)
    for plane in frame.planes:
        kind = np.uint16 if "10" in pixel_format or "12" in pixel_format else np.uint8
        np.frombuffer(memoryview(plane), kind)[...] = level
    frame.colorspace, frame.color_range = 1, color_range
    return frame


@pytest.mark.parametrize(
    ("pixel_format", "color_range", "changed"),
    [
        ("yuv420p", 1, "yuv420p"),
        ("yuv420p", 2, "yuv420p"),
        ("yuvj420p", 0, "yuvj420p"),
        ("yuv422p10le", 1, "yuv422p10le"),
        ("yuv444p12le", 1, "yuv444p12le"),
        ("yuv422p10le", 2, "yuv422p10le"),
        ("rgb24", 1, "yuv444p"),
    ],
)
def test_a_change_of_the_image_is_a_change_of_luma_and_chroma(
    pixel_format: str, color_range: int, changed: str
) -> None:
    """Red is 51 of 255 higher in the left half: 20 % of its weights, in the range and the bits of the format."""
    before, after = np.full((8, 16, 3), 90, np.uint8), np.full((8, 16, 3), 90, np.uint8)
    after[:, :8, 0] += 51
    frame = grey(pixel_format, color_range=color_range)
    found = changed_frame(frame, before, after)
    plain = frame.reformat(format="yuv444p") if changed != pixel_format else frame
    assert found.format.name == changed
    bits = 12 if "12" in changed else 10 if "10" in changed else 8
    ranges = np.array([255, 255, 255] if color_range == 2 or "j" in changed else [219, 224, 224]) * 2 ** (bits - 8)
    expected = 0.2 * matrix_of(1)[:, 0] * ranges
    kind = np.uint8 if bits == 8 else np.uint16
    for old, new, difference in zip(plain.planes, found.planes, expected, strict=True):
        rows = [np.frombuffer(bytes(plane), kind).reshape(plane.height, -1).astype(int) for plane in (old, new)]
        middle = old.width // 4
        assert (rows[1] - rows[0])[2, middle] == pytest.approx(difference, abs=0.51)
        assert (rows[1] - rows[0])[2, old.width - 2] == 0


def test_a_change_of_an_image_with_square_pixels_is_resized() -> None:
    """The frame has 16 stored columns, and its image 24 square pixels."""
    before, after = np.full((8, 24, 3), 90, np.uint8), np.full((8, 24, 3), 90, np.uint8)
    after[:, :12] += 30
    found = changed_frame(grey("yuv444p"), before, after)
    luma = np.frombuffer(bytes(found.planes[0]), np.uint8).reshape(8, -1)[:, :16].astype(int)
    assert (luma[:, :8] - 100 == round(30 / 255 * 219)).all()
    assert (luma[:, 8:] == 100).all()


@pytest.mark.parametrize(("tag", "uses_curve"), [(16, True), (18, True), (1, False)])
def test_a_change_of_an_hdr_frame_follows_its_curve(tag: int, uses_curve: bool) -> None:
    """Levels 50 and 150 of the image have a difference of 50, not 100, in the signal."""
    frame = grey("yuv444p", 128)
    luma = np.frombuffer(memoryview(frame.planes[0]), np.uint8).reshape(8, -1)
    luma[:, :8], luma[:, 8:16] = 80, 80 + round(50 / 255 * 219)
    frame.color_trc = tag
    before = np.full((8, 16, 3), 50, np.uint8)
    before[:, 8:] = 150
    after = before.copy()
    after[:, :4] = 150
    changed = changed_frame(frame, before, after)
    step = int(np.frombuffer(bytes(changed.planes[0]), np.uint8).reshape(8, -1)[2, 1]) - 80
    assert step == pytest.approx(43 if uses_curve else 86, abs=2)


@pytest.mark.parametrize(
    ("codec", "suffix", "name", "pixel_format"),
    [
        (None, ".mp4", "h264", "yuv420p"),
        ("h264", ".mkv", "h264", "yuv420p"),
        ("hevc", ".mp4", "hevc", "yuv420p"),
        ("lossless", ".mkv", "h264", "yuv420p"),
        ("vp9", ".webm", "vp9", "yuv420p"),
        (None, ".webm", "vp9", "yuv420p"),
        ("prores", ".mov", "prores", "yuv422p10le"),
    ],
)
def test_codecs_of_images_of_eight_bits(
    codec: str | None, suffix: str, name: str, pixel_format: str, tmp_path: Path
) -> None:
    """A video of images has 30 frames per second, BT.709 and limited range; ProRes has ten bits."""
    out = tmp_path / f"out{suffix}"
    with VideoWriter(out, suffix, codec=codec) as writer:
        writer.write(np.full((48, 64, 3), (200, 60, 40), np.uint8), 0.0)
    with av.open(str(out)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == (name, pixel_format)
        frame = next(container.decode(video=0))
    assert (int(frame.colorspace), int(frame.color_range)) == (1, 1)
    shown = next(Video(out).frames()).colour[24, 32].astype(int)
    assert np.abs(shown - (200, 60, 40)).max() <= 4


@pytest.mark.parametrize(("pixel_format", "stored"), [("yuvj420p", "yuv420p"), ("yuv411p", "yuv420p")])
def test_formats_that_no_encoder_supports_are_converted(pixel_format: str, stored: str, tmp_path: Path) -> None:
    source, out = tmp_path / "source.mkv", tmp_path / "out.mkv"
    with av.open(str(source), "w") as container:
        stream: Any = container.add_stream("ffv1" if pixel_format == "yuv411p" else "mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, pixel_format
        frame = grey(pixel_format, 120, (64, 48), 2 if pixel_format == "yuvj420p" else 1)
        frame.pts, frame.time_base = 0, Fraction(1, 25)
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with VideoWriter(out, ".mkv", source, codec="lossless") as writer:
        writer.write(next(Video(source).frames()).colour, 0.0)
    with av.open(str(out)) as container:
        assert next(container.decode(video=0)).format.name.replace("yuvj", "yuv") == stored
    apart = [next(Video(file).frames()).colour.astype(int) for file in (source, out)]
    assert np.abs(apart[0] - apart[1]).max() <= 2


def test_sound_of_a_range_begins_with_its_first_frame(tmp_path: Path) -> None:
    """Two seconds of sound in packets of 1024 of 8000 samples; frames 0.5 to 1.0 s are written, or all."""
    source = tmp_path / "source.mkv"
    with av.open(str(source), "w") as container:
        stream: Any = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        sound = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        for number in range(20):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), number, np.uint8), format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, 10)
            container.mux(stream.encode(frame))
            samples = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
            samples.sample_rate, samples.pts, samples.time_base = 8000, 800 * number, Fraction(1, 8000)
            container.mux(sound.encode(samples))
        container.mux(stream.encode())

    def times(first: int, last: int) -> list[float]:
        out = tmp_path / f"{first}.mkv"
        with VideoWriter(out, ".mkv", source) as writer:
            for number in range(first, last + 1):
                writer.write(np.full((48, 64, 3), number, np.uint8), number / 10, number)
        with av.open(str(out)) as container:
            return [
                round(float(packet.pts * packet.time_base), 2) for packet in container.demux(audio=0) if packet.size
            ]

    assert times(5, 10) == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5], abs=0.011)
    assert len(times(0, 3)) == 20


@pytest.mark.parametrize(("depth_mm", "stored"), [(65_535, 65_535), (65_536, 0), (1234, 1234)])
def test_depth_images_have_at_most_65535_mm(depth_mm: float, stored: int, tmp_path: Path) -> None:
    """Metres per unit are 0.5."""
    frame = Frame(0, "a.png", None, None, 0)
    writer = LayerWriter(tmp_path, [frame], 0.5)
    ones, colours = np.ones((8, 12), np.float32), np.ones((8, 12, 3), np.float32)
    depth = np.full((8, 12), depth_mm / 500, np.float32)
    image = ObjectImage(colours, ones, depth)
    writer.plate(frame, np.zeros((8, 12, 3), np.uint8))
    writer.layers(
        frame, 0, ObjectComposite(ObjectLayers(PixelBox(0, 0, 12, 8), image, colours, ones), 0 * ones, colours)
    )
    found = cv2.imread(str(tmp_path / "depth" / "a_1.png"), cv2.IMREAD_UNCHANGED)
    assert found is not None
    assert found.dtype == np.uint16
    assert found[4, 6] == stored


def test_nerfstudio_has_names_of_its_own_for_cameras(tmp_path: Path) -> None:
    def written(*cameras: Camera) -> dict[str, Any]:
        keys = [CameraKeyframe(f"{k}.png", float(k), camera, np.eye(4)) for k, camera in enumerate(cameras)]
        write_transforms(tmp_path / "transforms.json", keys, "pictures", np.zeros((2, 3)))
        document: dict[str, Any] = json.loads((tmp_path / "transforms.json").read_text())
        return document

    radial = Camera("SIMPLE_RADIAL", 12, 8, np.array([10.0, 6, 4, -0.1]))
    one = written(radial)
    assert (one["camera_model"], one["k1"], one["fl_x"], one["cx"]) == ("OPENCV", -0.1, 10.0, 6.0)
    assert "k1" not in one["frames"][0]
    two = written(CAMERA, radial)
    assert two["camera_model"] == "PINHOLE"
    assert [frame.get("k1") for frame in two["frames"]] == [None, -0.1]
    with pytest.raises(InputError, match=r"transforms.json: expected one of .*; found FOV"):
        written(Camera("FOV", 12, 8, np.array([10.0, 10, 6, 4, 0.1])))
