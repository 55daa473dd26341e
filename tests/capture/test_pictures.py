"""Folders of images: order, orientation, focal length, and folders that are refused."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from PIL import Image

from capture.sources import frames
from capture.sources.frames import is_capture, make_frames, read_frames, source_of
from capture.sources.image_folder import ImageFolder
from capture.sources.video import VideoFrame
from metric_base.errors import InputError


def _picture(file: Path, orientation: int = 1, focal_35mm: int | None = None, size: tuple[int, int] = (80, 60)) -> None:
    """An image with a red upper left corner as it is stored."""
    pixels = np.full((size[1], size[0], 3), 120, dtype=np.uint8)
    pixels[:20, :20] = (230, 10, 10)
    picture = Image.fromarray(pixels)
    exif = picture.getexif()
    exif[0x0112] = orientation
    if focal_35mm is not None:
        exif.get_ifd(0x8769)[0xA405] = focal_35mm
    picture.save(file, exif=exif, quality=95)


def test_pictures_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for name in ("IMG_10.jpg", "IMG_9.jpg", "img_2.png", ".hidden.jpg", "notes.txt"):
        _picture(tmp_path / name) if name.endswith(("jpg", "png")) else (tmp_path / name).write_text("x")
    folder = ImageFolder(tmp_path)
    assert [file.name for file in folder.files] == ["img_2.png", "IMG_9.jpg", "IMG_10.jpg"]


@pytest.mark.parametrize(
    ("orientation", "corner"), [(1, (0, 0)), (3, (-1, -1)), (6, (0, -1)), (8, (-1, 0)), (2, (0, -1)), (7, (-1, -1))]
)
def test_pictures_are_turned_upright(tmp_path: Path, orientation: int, corner: tuple[int, int]) -> None:
    _picture(tmp_path / "a.jpg", orientation)
    _picture(tmp_path / "b.jpg", orientation)
    folder = ImageFolder(tmp_path)
    frame = next(folder.frames())
    assert (folder.width, folder.height) == ((60, 80) if orientation > 4 else (80, 60))
    assert frame.colour.shape[:2] == (folder.height, folder.width)
    red = frame.colour[5 if corner[0] == 0 else -5, 5 if corner[1] == 0 else -5].astype(int)
    assert red[0] > 180 > 60 > red[2]


def test_the_focal_length_is_exifs(tmp_path: Path) -> None:
    _picture(tmp_path / "a.jpg", focal_35mm=26)
    _picture(tmp_path / "b.jpg", focal_35mm=26)
    focal = pytest.approx(26 / 43.2666 * 100)  # the diagonal of 80 x 60 is 100
    assert ImageFolder(tmp_path).focals_px == [focal, focal]
    _picture(tmp_path / "a.jpg")
    assert ImageFolder(tmp_path).focals_px == [None, focal]


def test_pictures_of_one_size_and_focal_length_share_a_camera(tmp_path: Path) -> None:
    """Two telephones; the second is also held upright."""
    for name, how in {"a": (1, 26), "b": (6, 26), "c": (1, 24), "d": (1, 26), "e": (6, 26), "f": (1, None)}.items():
        _picture(tmp_path / f"{name}.jpg", orientation=how[0], focal_35mm=how[1])
    part = tmp_path / "part"
    part.mkdir()
    make_frames(part, source_of(tmp_path), wanted=None)
    frames = read_frames(part)
    assert not frames.one_camera
    assert list(frames.cameras().values()) == [["a.jpg", "d.jpg"], ["b.jpg", "e.jpg"], ["c.jpg"], ["f.jpg"]]
    widths = [(width, None if focal is None else round(focal)) for width, _, focal in frames.cameras()]
    assert widths == [(80, 60), (60, 60), (80, 55), (80, None)]


def test_frames_are_kept_by_their_names(tmp_path: Path) -> None:
    for k in range(6):
        _picture(tmp_path / f"p{k}.jpg", orientation=6)
    part = tmp_path / "part"
    part.mkdir()
    make_frames(part, source_of(tmp_path), wanted=3)
    frames = read_frames(part)
    assert (frames.names, [frame.index for frame in frames.chosen]) == (["p0.jpg", "p2.jpg", "p5.jpg"], [0, 2, 5])
    assert (frames.file_size, frames.one_camera, frames.times_s) == ((60, 80), True, None)
    assert Image.open(part / "frames" / "p0.jpg").getexif().get(0x0112) is None  # upright, once and for all


def test_what_is_a_capture(tmp_path: Path) -> None:
    _picture(tmp_path / "a.jpg")
    assert not is_capture(tmp_path)  # one image is no reconstruction's worth
    _picture(tmp_path / "b.jpg")
    assert is_capture(tmp_path)
    assert is_capture(tmp_path / "video.MP4")  # so that a missing video is named as one
    assert not is_capture(tmp_path / "nothing")
    assert not is_capture(Path("data/scenes/demo_room"))
    (tmp_path / "reconstruction.json").write_text("[]")
    assert not is_capture(tmp_path)


def test_pictures_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    (tmp_path / "IMG_1.HEIC").write_bytes(b"x")
    with pytest.raises(InputError, match=r"IMG_1\.HEIC; convert it to JPEG"):
        ImageFolder(tmp_path)
    (tmp_path / "a.jpg").write_bytes(b"not a picture")
    with pytest.raises(InputError, match=r"a\.jpg: image"):
        ImageFolder(tmp_path)


def test_pictures_that_are_left_out_are_named(tmp_path: Path) -> None:
    for name in ("a.jpg", "b.jpg"):
        _picture(tmp_path / name)
    (tmp_path / "IMG_3.HEIC").write_bytes(b"")
    part = tmp_path / "part"
    part.mkdir()
    make_frames(part, source_of(tmp_path), wanted=None)
    assert read_frames(part).remarks == ["not used: IMG_3.HEIC; convert to JPEG"]
    for name in ("a.jpg", "b.jpg"):
        (tmp_path / name).rename(tmp_path / f"{name}.HEIC")
    assert is_capture(tmp_path)
    with pytest.raises(InputError, match=r"found IMG_3\.HEIC; convert it to JPEG"):
        source_of(tmp_path)


@pytest.mark.parametrize(
    ("size", "written"),
    [((1900, 40), (1900, 40)), ((1920, 40), (1920, 40)), ((2400, 40), (1920, 32)), ((30, 2000), (29, 1920))],
)
def test_a_frame_is_reduced_to_1920_pixels(size: tuple[int, int], written: tuple[int, int], tmp_path: Path) -> None:
    colour = np.zeros((size[1], size[0], 3), dtype=np.uint8)
    video = SimpleNamespace(path=tmp_path / "a.mp4", focal_px=100.0)
    frame = frames.write_frame(tmp_path, VideoFrame(7, 0.5, colour), video)  # type: ignore[arg-type]
    assert (frame.name, frame.width, frame.height, frame.time_s) == ("000007.jpg", *written, 0.5)
    assert frame.focal_px == pytest.approx(100 * max(written) / max(size))
    assert cv2.imread(str(tmp_path / frame.name)).shape[:2] == written[::-1]


@pytest.mark.parametrize(("n_images", "found"), [(1, False), (2, True)])
def test_a_capture_is_a_folder_of_two_images(n_images: int, found: bool, tmp_path: Path) -> None:
    (tmp_path / "input").mkdir()
    for index in range(n_images):
        cv2.imwrite(str(tmp_path / "input" / f"{index}.png"), np.zeros((4, 4), dtype=np.uint8))
    assert is_capture(tmp_path / "input") == found
    assert frames.capture_folder(tmp_path) == (tmp_path / "input" if found else tmp_path)
    assert is_capture(tmp_path / "a.mp4")
    assert not is_capture(tmp_path / "a.txt")
