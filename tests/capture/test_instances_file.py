"""The dataset of masks in a work folder: the part about the chosen frames, and the whole if it is no valid dataset."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from capture.caution_files import CAUTIONS_FILE, read_cautions
from capture.masks.instances_file import INSTANCES, copy_dataset
from capture.sources.frames import FRAMES_FILE, ChosenFrame, Frames
from capture.work_folder import WorkFolder
from metric_base.errors import InputError

IMAGES: list[dict[str, Any]] = [{"id": 1, "file_name": "video/000001.jpg"}, {"id": 2, "file_name": "video/000002.jpg"}]
MASKS = [{"id": 7, "image_id": 1}, {"id": 8, "image_id": 2}, {"id": 9, "image_id": 3}]


def _copied(folder: Path, document: object) -> Any:
    """The document in the work folder of a video whose frame 000001.jpg is chosen; None for one that is not copied."""
    work = folder / "work"
    work.mkdir()
    chosen = [ChosenFrame(1, "000001.jpg", 0.1, 640, 480, None, (0.2, 0.2))]
    frames = Frames(source="/a", size=(640, 480), turned_deg=0, hdr=None, remarks=[], times_s=None, chosen=chosen)
    (work / FRAMES_FILE).write_bytes(msgspec.json.encode(frames))
    (folder / "masks.json").write_text(json.dumps(document), encoding="utf-8")
    with WorkFolder(work).lock():
        is_copied = copy_dataset(folder / "masks.json", WorkFolder(work))
    assert is_copied == (work / INSTANCES).is_file()
    return json.loads((work / INSTANCES).read_text(encoding="utf-8")) if is_copied else None


def test_the_masks_of_the_chosen_frames_are_copied_with_those_that_have_no_image(tmp_path: Path) -> None:
    document = _copied(tmp_path, {"images": IMAGES, "annotations": MASKS, "categories": [5]})
    assert document == {"images": IMAGES[:1], "annotations": [MASKS[0], MASKS[2]], "categories": [5]}


@pytest.mark.parametrize(
    "document",
    [
        {"images": IMAGES[1:], "annotations": MASKS},  # no chosen frame
        {"images": IMAGES, "annotations": 3},
        {"images": 3, "annotations": MASKS},
        {"images": [*IMAGES, 3], "annotations": MASKS},
        {"images": IMAGES, "annotations": [*MASKS, 3]},
        {"images": [IMAGES[0] | {"id": None}, IMAGES[1]], "annotations": MASKS},
    ],
)
def test_a_document_of_another_form_is_copied_whole(document: dict[str, Any], tmp_path: Path) -> None:
    assert _copied(tmp_path, document) == document


def test_bare_results_are_read_in_place(tmp_path: Path) -> None:
    assert _copied(tmp_path, MASKS) is None


@pytest.mark.parametrize(
    ("content", "cautions"),
    [(None, ()), ({"cautions": ["a"]}, ("a",)), (["a", "b"], ("a", "b")), ({"cautions": [3]}, None), ({}, None)],
)
def test_warnings_of_a_capture_are_sentences(content: object, cautions: tuple[str, ...] | None, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / CAUTIONS_FILE).write_text(json.dumps(content), encoding="utf-8")
    if cautions is not None:
        assert read_cautions(tmp_path) == cautions
    else:
        with pytest.raises(InputError, match=CAUTIONS_FILE):
            read_cautions(tmp_path)
