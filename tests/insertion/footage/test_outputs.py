"""Images are written inside their folder, each under a distinct name, and never over an input."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest

from estimator.reconstructions.scene_reader import read_scene
from insertion.composite.compose import ObjectComposite
from insertion.exports.export_folder import LayerWriter
from insertion.footage import footage
from insertion.footage.footage import Frame, SceneImages
from insertion.footage.image_writer import check_preview_path, frame_writer
from insertion.render.layers import ObjectLayers
from insertion.render.renderer import ObjectImage
from insertion.scene.pixel_box import PixelBox
from metric_base.errors import InputError

DEMO_ROOM = Path(__file__).resolve().parents[3] / "data" / "scenes" / "demo_room"
PICTURE = np.full((8, 9, 3), 90, dtype=np.uint8)
NAMES = ("../images/a.jpg", "/etc/a.png", "a.jpg", "a.png", "b/../../c.jpg", "A.PNG", "no ending")
SHOTS = [Frame(index, name, None, None, index) for index, name in enumerate(NAMES)]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """An image of the user's, where a name from the model leads to."""
    file = tmp_path / "images" / "a.png"
    file.parent.mkdir()
    file.write_bytes(b"the user's own")
    return file


def test_names_of_frames_stay_inside_the_output_and_are_distinct(tmp_path: Path, source: Path) -> None:
    with frame_writer(tmp_path / "out") as write:
        for shot in SHOTS:
            write(shot, PICTURE)
    assert len([path for path in (tmp_path / "out").rglob("*") if path.is_file()]) == len(NAMES)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["images", "out"]
    assert source.read_bytes() == b"the user's own"


def test_names_of_frames_stay_inside_an_export(tmp_path: Path, source: Path) -> None:
    (tmp_path / "export").mkdir()
    layers = LayerWriter(tmp_path / "export", SHOTS, 0.5)
    ones, colours = np.ones((8, 9), np.float32), np.ones((8, 9, 3), np.float32)
    image = ObjectImage(colours, ones, ones)
    joined = ObjectComposite(ObjectLayers(PixelBox(0, 0, 9, 8), image, colours, ones), 0 * ones, colours)
    for shot in SHOTS:
        layers.plate(shot, PICTURE)
        layers.layers(shot, 0, joined)
    for part in ("pictures", "mask", "depth"):
        assert len([path for path in (tmp_path / "export" / part).rglob("*") if path.is_file()]) == len(NAMES)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["export", "images"]
    assert source.read_bytes() == b"the user's own"


def test_a_disk_that_is_full_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match="No space left on device"), frame_writer(tmp_path / "out") as write:
        write(SHOTS[2], PICTURE)
    assert list(tmp_path.iterdir()) == []


def test_a_preview_is_a_picture(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--preview: expected an image file"):
        check_preview_path(tmp_path / "preview.xyz")


@pytest.mark.parametrize(("images", "reads"), [(0, 4), (1, 3), (2, 2)])
def test_decoded_images_are_kept_up_to_a_size(images: int, reads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    decoded = SceneImages(read_scene(DEMO_ROOM))
    size = decoded.image(0).nbytes
    monkeypatch.setattr(footage, "MAX_DECODED_BYTES", (images + 1) * size - 1 if images < 2 else 2 * size)
    fresh, files = SceneImages(decoded.scene), []
    read = footage.read_image
    monkeypatch.setattr(footage, "read_image", lambda file, how: files.append(file) or read(file, how))
    assert [fresh.image(row).nbytes for row in (0, 0, 1, 1)] == [size] * 4
    assert len(files) == reads
