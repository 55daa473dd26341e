from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from crawler.fetch.item_images import SCHEMA as PICTURE
from metric_base.errors import FieldError
from metric_tree.release import schema
from metric_tree.release.images import check_image_record
from metric_tree.release.release import MANIFEST, BadRelease, Release, open_release, sha256
from metric_tree.tree import open_tree
from tests.synthetic import minitree


def test_a_release_is_written_whole(tmp_path: Path) -> None:
    release = minitree.release(tmp_path / "1.0.0")
    assert open_release(tmp_path / "1.0.0").manifest == release.manifest
    assert sorted(path.name for path in (tmp_path / "1.0.0").iterdir()) == sorted([MANIFEST, *schema.TABLES])
    assert [path.name for path in tmp_path.iterdir()] == ["1.0.0"]  # no work folder is left


def test_a_release_is_never_changed(tmp_path: Path) -> None:
    minitree.release(tmp_path / "1.0.0")
    with pytest.raises(BadRelease, match="already exists"):
        minitree.release(tmp_path / "1.0.0")


def test_a_failed_release_leaves_nothing(tmp_path: Path) -> None:
    content = minitree.rows()
    content["nodes.parquet"][0]["level"] = "five"
    with pytest.raises(Exception, match="five"):
        minitree.release(tmp_path / "1.0.0", content)
    assert list(tmp_path.iterdir()) == []


def test_bytes_are_the_same_every_time(tmp_path: Path) -> None:
    one, two = (minitree.release(tmp_path / name).manifest["files"] for name in ("a", "b"))
    assert one == two


@pytest.mark.parametrize("name", schema.TABLES)
def test_every_column_says_what_it_means(name: str) -> None:
    for field in schema.TABLES[name]:
        assert field.metadata[b"meaning"]
        assert b"unit" in field.metadata or not field.name.endswith(("_mm", "_px"))


def test_the_unit_travels_in_the_file(tmp_path: Path) -> None:
    table = minitree.release(tmp_path / "r").table("items")
    assert table.schema.field("length_mm").metadata[b"unit"] == b"mm"


def _change(directory: Path, **values: object) -> None:
    manifest = json.loads((directory / MANIFEST).read_text())
    (directory / MANIFEST).write_text(json.dumps(manifest | values))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda nodes: nodes.clear(), "found no node"),
        (lambda nodes: nodes.append(dict(nodes[-1])), "expected ids that differ; found 1 twice"),
        (lambda nodes: nodes[-1].update(node_id="a\0b"), "expected printable ids"),
        (lambda nodes: nodes[-1].update(parent_id="a\x1b[2J"), r"expected the id of a node; found 'a\\x1b"),
    ],
)
def test_a_table_of_nodes_that_is_no_tree_is_one_line(change, message: str, tmp_path: Path) -> None:
    content = minitree.rows()
    change(content["nodes.parquet"])
    minitree.release(tmp_path / "r", content)
    with pytest.raises(BadRelease, match=message):
        open_tree(tmp_path / "r")


def test_a_tree_that_is_a_circle_is_one_line(tmp_path: Path) -> None:
    content = minitree.rows()
    nodes = {node["node_id"]: node for node in content["nodes.parquet"]}
    nodes["seat.n.03"]["parent_id"] = "chair.n.01"
    minitree.release(tmp_path / "r", content)
    with pytest.raises(BadRelease, match=r"parent_id: expected a tree; found a circle"):
        open_tree(tmp_path / "r")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda d: (d / MANIFEST).unlink(), "expected the manifest of a release; found no file"),
        (lambda d: (d / MANIFEST).write_text("{"), "expected a JSON manifest"),
        (lambda d: (d / MANIFEST).write_text("[]"), "expected metric-tree/1"),
        (lambda d: (d / MANIFEST).write_text(json.dumps({"schema": "metric-tree/2"})), "found 'metric-tree/2'"),
        (lambda d: (d / MANIFEST).write_text(json.dumps({"schema": "metric-tree/1"})), "name: expected a value"),
        (lambda d: _change(d, counts="x"), "counts: expected an object; found str"),
        (lambda d: _change(d, counts={"nodes": float("nan")}), "counts.nodes: expected a whole number; found nan"),
        (lambda d: _change(d, sources=[{"id": "../../up"}]), "sources: expected objects with an id of letters"),
        (lambda d: _change(d, sources=["x"]), "sources: expected objects"),
        (lambda d: _change(d, name=5), "name: expected text; found int"),
        (lambda d: _change(d, heights=3), "heights: expected an object for each node; found others"),
        (lambda d: _change(d, heights={"chair.n.01": "high"}), "heights: expected an object for each node"),
        (lambda d: _change(d, states={"chair.n.01": ["folded"]}), "states: expected an array for each node"),
        (lambda d: (d / "nodes.parquet").unlink(), "found no file"),
        (lambda d: (d / "items.parquet").write_bytes(b"PAR1"), "expected .* bytes; found 4"),
    ],
)
def test_damage_is_one_clear_line(tmp_path: Path, damage, message: str) -> None:
    minitree.release(tmp_path / "r")
    damage(tmp_path / "r")
    with pytest.raises(BadRelease, match=message) as error:
        open_release(tmp_path / "r")
    assert "\n" not in str(error.value)
    assert str(tmp_path) in str(error.value)


def test_a_table_altered_at_equal_size_is_noticed(tmp_path):
    release = minitree.release(tmp_path / "r")
    path = release.directory / "priors.parquet"
    assert release.table("priors").num_rows > 0
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(BadRelease, match=r"priors\.parquet: sha256: expected [0-9a-f]{64} .* found [0-9a-f]{64}"):
        open_release(release.directory).table("priors")
    with pytest.raises(BadRelease, match="altered"):
        release.table("priors")


@pytest.mark.parametrize(("n", "is_read"), [(10_000_000, True), (10_000_001, False)])
def test_a_table_has_at_most_ten_million_rows(
    n: int, is_read: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class File(nullcontext[Any]):
        metadata, num_row_groups = SimpleNamespace(num_rows=n), 1

        def __init__(self, _: Path) -> None:
            super().__init__(self)

        def read(self, *_: object, **__: object) -> pa.Table:
            return pa.table({})

    (path := tmp_path / "nodes.parquet").touch()
    monkeypatch.setattr(pq, "ParquetFile", File)
    release = Release(tmp_path, {"files": {path.name: {"sha256": sha256(path)}}})
    with nullcontext() if is_read else pytest.raises(BadRelease, match="rows: expected at most 10,000,000"):
        assert release.unchecked_table("nodes").num_rows == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda table: table.set_column(0, "node_id", table["name"].cast(pa.large_string())),
            "node_id: expected string",
        ),
        (lambda table: table.set_column(0, "node_id", pa.nulls(table.num_rows, pa.string())), "found .* without"),
        (lambda table: table.drop_columns(["level"]), "level: expected the column; found none"),
    ],
)
def test_a_table_of_another_form_is_one_line(change: Any, message: str, tmp_path: Path) -> None:
    release = minitree.release(tmp_path / "r")
    path = release.directory / "items.parquet" if "level" not in message else release.directory / "nodes.parquet"
    table = pq.read_table(path)
    position = table.schema.get_field_index("node_id")
    table = table.select(["node_id", *(name for name in table.column_names if name != "node_id")])
    table = table.append_column("name", table["node_id"]) if "name" not in table.column_names else table
    assert position >= 0
    pq.write_table(change(table), path)
    release.manifest["files"][path.name] |= {"sha256": sha256(path)}
    with pytest.raises(BadRelease, match=message):
        release.table(path.stem)
    if "without" not in message:
        with pytest.raises(BadRelease, match=message):
            release.table(path.stem, {"swivel_chair.n.01"})


def test_a_manifest_without_a_table_is_one_line(tmp_path: Path) -> None:
    release = minitree.release(tmp_path / "r")
    path = release.directory / "manifest.json"
    manifest = json.loads(path.read_text())
    for entry in (None, {}, 3):
        manifest["files"]["items.parquet"] = entry
        path.write_text(json.dumps(manifest))
        with pytest.raises(BadRelease, match=r"files: expected an entry for items\.parquet; found"):
            open_release(release.directory)


@pytest.mark.parametrize(("pixels", "is_valid"), [((1 << 20) - 1, True), (1 << 20, False), (0, False), (None, False)])
def test_the_record_of_an_image_has_a_size(pixels: int | None, is_valid: bool) -> None:
    name = "ab" + "0" * 62
    record = {"schema": PICTURE, "image_id": name, "item_id": "a:1", "source_url": "u", "path": f"ab/{name}.jpg"}
    with nullcontext() if is_valid else pytest.raises(FieldError, match="width_px: expected pixels"):
        check_image_record(record | {"width_px": pixels, "height_px": 5})
