"""Sizes of files: the largest one that a reader opens, and one byte more."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np
import pytest

from crawler.page.page import saved_page
from estimator.detectors.detector import load_detector
from estimator.detectors.registry import registry
from estimator.scene_formats.depth_files import read_exr
from estimator.scene_formats.metashape import read_metashape
from estimator.telemetry.readers import read_telemetry
from insertion.scene.scale import read_scale
from metric_base import images, input_files
from metric_base.errors import InputError
from metric_base.records import toml_table
from models3d.formats import read_asset, read_boxes
from tests.synthetic.networks import exr_bytes

Reader = Callable[[Path], object]
MB = 1 << 20


def _labels(path: Path) -> object:
    detector = path.with_name("detector.onnx")
    detector.touch()
    return load_detector(detector, path)


@pytest.fixture
def only_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the start of a file is read, because zeros of a gigabyte take a second."""

    real = os.fdopen

    def opened(descriptor: int, mode: str) -> IO[Any]:
        with real(descriptor, mode) as file:
            return io.BytesIO(file.read(1 << 16))

    monkeypatch.setattr(input_files.os, "fdopen", opened)
    monkeypatch.setattr(Path, "read_bytes", lambda path: path.open("rb").read(4096))
    monkeypatch.setattr(images.np, "fromfile", lambda path, dtype: np.frombuffer(path.read_bytes(), dtype))


READERS: dict[str, tuple[str, Reader, int]] = {
    "OBJ": ("a.obj", read_asset, 512 * MB),
    "COLLADA": ("a.dae", read_asset, 512 * MB),
    "glTF": ("a.gltf", read_asset, 512 * MB),
    "URDF": ("a.urdf", read_asset, 64 * MB),
    "table of boxes": ("a.csv", lambda path: list(read_boxes(path)), 256 * MB),
    "Metashape": ("a.xml", read_metashape, 256 * MB),
    "subtitles": ("a.srt", read_telemetry, 256 * MB),
    "result": ("result.json", lambda path: read_scale(path.parent, None), 128 * MB),
    "names of classes": ("labels.txt", _labels, 16 * MB),
    "list of detectors": ("detectors.toml", registry, 4 * MB),
    "TOML": ("a.toml", toml_table, 4 * MB),
}


@pytest.mark.usefixtures("only_the_start")
@pytest.mark.parametrize("kind", READERS)
def test_a_file_above_its_limit_is_refused_before_it_is_read(kind: str, tmp_path: Path) -> None:
    name, read, limit = READERS[kind]
    path = tmp_path / name
    for size, is_refused in ((limit, False), (limit + 1, True)):
        with path.open("wb") as file:
            file.truncate(size)
        try:
            read(path)
            message = ""
        except InputError as error:
            message = str(error)
        assert (f"at most {limit:,} bytes" in message) == is_refused


@pytest.mark.usefixtures("only_the_start")
@pytest.mark.parametrize(("size", "is_read"), [(1 << 30, True), ((1 << 30) + 1, False)])
def test_a_depth_map_has_at_most_a_gibibyte(size: int, is_read: bool, tmp_path: Path) -> None:
    path = tmp_path / "depth.exr"
    path.write_bytes(exr_bytes({"Z": np.full((4, 6), 2.0)}, np.float32))
    with path.open("ab") as file:
        file.truncate(size)
    with nullcontext() if is_read else pytest.raises(InputError, match="OpenEXR"):
        assert read_exr(path).shape == (4, 6)


@pytest.mark.usefixtures("only_the_start")
@pytest.mark.parametrize(("size", "is_read"), [(32_000_000, True), (32_000_001, False)])
def test_a_page_has_at_most_32_megabytes(size: int, is_read: bool, tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_bytes(b"<html><title>A chair</title>" + b" " * 4096)
    with path.open("ab") as file:
        file.truncate(size)
    with nullcontext() if is_read else pytest.raises(InputError, match="at most 32000000 bytes"):
        assert "A chair" in str(saved_page(path, "https://example.org/").text)


@pytest.mark.usefixtures("only_the_start")
@pytest.mark.parametrize(("size", "is_read"), [(1 << 30, True), ((1 << 30) + 1, False)])
def test_an_image_has_at_most_a_gibibyte(size: int, is_read: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.full((4, 6), 90, dtype=np.uint8))
    with path.open("ab") as file:
        file.truncate(size)
    with nullcontext() if is_read else pytest.raises(InputError, match="an image that OpenCV reads"):
        assert images.checked_image(path, cv2.IMREAD_GRAYSCALE).shape == (4, 6)
