"""The trainer of detectors: reading an exported set, order of the images, mask AP, and the registration of a network.

The training itself needs torch: `make train-check`.
"""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from estimator.detectors.registry import file_sha256, registry_entry
from metric_tree.training.annotations import run_lengths

SCRIPT = Path(__file__).resolve().parents[2] / "integrations" / "train_detector" / "train_detector.py"


@pytest.fixture(scope="module")
def trainer() -> ModuleType:
    spec = importlib.util.spec_from_file_location("train_detector", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def write_split(folder: Path, ids: tuple[int, ...] = (1, 2)) -> list[np.ndarray]:
    """Write the annotations of one image with an object of each class, and return the masks."""
    masks = []
    annotations: list[dict[str, Any]] = []
    for number, category in enumerate(ids):
        mask = np.zeros((40, 60), dtype=bool)
        mask[5:30, 5 + 30 * number : 25 + 30 * number] = True
        runs, area, bbox = run_lengths(mask)
        annotations.append({
            "id": number + 1, "image_id": 1, "category_id": category, "segmentation": runs, "area": area,
            "bbox": list(bbox), "iscrowd": 0,
        })  # fmt: skip
        masks.append(mask)
    document = {
        "images": [{"id": 1, "file_name": "val/1.jpg", "width": 60, "height": 40}],
        "annotations": annotations,
        "categories": [{"id": k, "name": f"class {k}"} for k in ids],
    }
    (folder / "annotations").mkdir()
    (folder / "annotations" / "instances_val.json").write_text(json.dumps(document))
    return masks


def test_mask_ap_is_one_for_the_true_masks_and_zero_for_swapped_classes(trainer: ModuleType, tmp_path: Path) -> None:
    masks = write_split(tmp_path)
    split = trainer.Split(tmp_path, "val")

    def results(labels: tuple[int, int]) -> list[dict[str, Any]]:
        runs = [run_lengths(mask)[0] for mask in masks]
        return [
            {"image_id": 1, "category_id": label, "score": 0.9, "segmentation": run}
            for label, run in zip(labels, runs, strict=True)
        ]

    assert trainer.mask_ap(split, results((1, 2)))["mean"] == {"AP": 1.0, "AP50": 1.0}
    assert trainer.mask_ap(split, results((2, 1)))["mean"] == {"AP": 0.0, "AP50": 0.0}
    half = trainer.mask_ap(split, results((1, 2))[:1])
    assert (half["class 1"]["AP50"], half["class 2"]["AP50"], half["mean"]["AP50"]) == (1.0, 0.0, 0.5)
    assert trainer.mask_ap(split, [])["class 1"] == {"AP": 0.0, "AP50": 0.0}


def test_a_set_without_annotations_or_with_other_ids_is_refused(trainer: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"instances_val\.json: expected the annotations"):
        trainer.Split(tmp_path, "val")
    write_split(tmp_path, (1, 3))
    with pytest.raises(SystemExit, match=r"expected ids from 1 to n; found \[1, 3\]"):
        trainer.Split(tmp_path, "val")


def test_a_continued_training_sees_the_same_images_in_the_same_order(trainer: ModuleType) -> None:
    complete = list(trainer.batches(10, 4, seed=3, start=0, stop=6))
    assert complete[3:] == list(trainer.batches(10, 4, seed=3, start=3, stop=6))
    first_epoch = [index for batch in complete[:2] for index, _ in batch]
    assert len(set(first_epoch)) == 8
    assert complete != list(trainer.batches(10, 4, seed=4, start=0, stop=6))


def test_the_learning_rate_rises_linearly_and_falls_to_zero(trainer: ModuleType) -> None:
    rates = [trainer.learning_rate(step, 1000, 1e-3) for step in range(1001)]
    assert rates[0] == pytest.approx(1e-3 / trainer.WARMUP_STEPS)
    assert max(rates) <= 1e-3
    assert rates[-1] == pytest.approx(0)


def test_estimate_scale_takes_the_registration(trainer: ModuleType, tmp_path: Path) -> None:
    model = tmp_path / "model.onnx"
    model.write_bytes(b"a network")
    (tmp_path / "detector.toml").write_text(trainer.registration(model, ["trash can", "café table"], 'of "a set"'))
    entry = registry_entry(str(tmp_path / "detector.toml"))
    assert (entry.file, entry.sha256, entry.input) == (model, file_sha256(model), "torchvision")
    assert entry.labels == ("", "trash can", "café table")
    assert entry.title == 'of "a set"'


def test_the_learning_curve_is_an_image(trainer: ModuleType, tmp_path: Path) -> None:
    ap = {"chair": {"AP": 0.4, "AP50": 0.6}, "mean": {"AP": 0.4, "AP50": None}}
    trainer.draw_curve(np.linspace(2, 1, 120).tolist(), ap, tmp_path / "curve.png")
    assert (tmp_path / "curve.png").read_bytes().startswith(b"\x89PNG")
