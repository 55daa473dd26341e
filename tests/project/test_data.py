"""The shared store of images: complete, without unused files, and without copies."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from metric_tree.release.images import FOLDER, STORE, stored_file
from metric_tree.release.release import sha256

DATA = Path(__file__).resolve().parents[2] / "data"
RELEASES = sorted(path.parent for path in DATA.glob("release/*/manifest.json"))


def _named() -> set[str]:
    """Return the images that the shipped releases and raw items name, relative to the store."""
    names = set()
    for release in RELEASES:
        table = pq.read_table(release / "images.parquet", columns=["path", "cutout_path"])
        names |= {name for column in table.columns for name in column.to_pylist() if name}
        extras = json.loads((release / "manifest.json").read_text(encoding="utf-8")).get("extras", {})
        names |= {name for name in extras if name.startswith(f"{FOLDER}/")}
    for records in DATA.glob("raw/pictures-*.jsonl"):
        lines = records.read_text(encoding="utf-8").splitlines()
        names |= {f"{FOLDER}/{json.loads(line)['path']}" for line in lines}
    return {name.removeprefix(f"{FOLDER}/") for name in names}


def test_the_store_contains_the_named_images_and_no_others() -> None:
    stored = {path.relative_to(DATA / STORE).as_posix() for path in (DATA / STORE).rglob("*") if path.is_file()}
    assert stored == _named()
    assert len(stored) > 2000


def test_images_have_the_hash_that_is_their_name() -> None:
    for path in (DATA / STORE).rglob("*.*"):
        assert sha256(path) == path.stem
        assert path.parent.name == path.stem[:2]


def test_no_image_is_stored_twice() -> None:
    assert not [path for path in DATA.rglob(FOLDER) if path.is_dir()]


def test_releases_and_raw_items_find_the_images_in_the_store() -> None:
    name = f"{FOLDER}/{sorted(_named())[0]}"
    for folder in (RELEASES[-1], DATA / "raw"):
        assert stored_file(folder, name) == DATA / STORE / name.removeprefix(f"{FOLDER}/")


@pytest.mark.parametrize("release", RELEASES, ids=lambda release: release.name)
def test_texts_of_shipped_releases_are_unchanged(release: Path) -> None:
    extras = json.loads((release / "manifest.json").read_text(encoding="utf-8")).get("extras", {})
    texts = {name: digest for name, digest in extras.items() if not name.startswith(f"{FOLDER}/")}
    assert {name: sha256(release / name) for name in texts} == texts
