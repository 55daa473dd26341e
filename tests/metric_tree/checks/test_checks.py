"""A fixture for each code: the valid release with one error put in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from metric_tree.checks.release_files import CODES, findings
from metric_tree.release.release import MANIFEST
from tests.synthetic import minitree

Rows = minitree.Rows
Error = Callable[[Rows], None]

SIZES = ("length_mm", "width_mm", "height_mm")
NODE, ITEM, PRIOR = "nodes.parquet", "items.parquet", "priors.parquet"


def _set(table: str, row: int, **values: Any) -> Error:
    return lambda content: content[table][row].update(values)


def _node(content: Rows, node_id: str) -> dict[str, Any]:
    return next(row for row in content[NODE] if row["node_id"] == node_id)


def _class(content: Rows, node_id: str) -> list[dict[str, Any]]:
    return [row for row in content[ITEM] if row["node_id"] == node_id]


def _resize(node_id: str, sizes: Callable[[int, dict[str, Any]], dict[str, Any]]) -> Error:
    """Give the items of a node other sizes."""

    def change(content: Rows) -> None:
        for number, item in enumerate(_class(content, node_id)):
            item.update(sizes(number, item))

    return change


def _orphan(content: Rows) -> None:
    _node(content, "mt:bar_stool")["parent_id"] = "stool.n.01"


def _cycle(content: Rows) -> None:
    _node(content, "seat.n.03")["parent_id"] = "chair.n.01"


def _rename(content: Rows) -> None:
    for node_id in ("mt:bar_stool",):
        row = _node(content, node_id)
        row.update(name="swivel chair", path=[*row["path"][:-1], "swivel chair"])


def _lone_child(content: Rows) -> None:
    content[NODE] = [row for row in content[NODE] if row["node_id"] != "rat.n.01"]


def _menu(content: Rows) -> None:
    row = _node(content, "device.n.01")
    row.update(node_id="accessories", synset=None)
    _node(content, "pointer.n.01")["parent_id"] = "accessories"


def _grid(number: int, _: dict[str, Any]) -> dict[str, float]:
    return {"length_mm": 600.0 + 10 * (number % 3), "width_mm": 500.0, "height_mm": 900.0 + 10 * (number // 3)}


def _copies(number: int, _: dict[str, Any]) -> dict[str, Any]:
    sizes = [600.0 + number // 3, 500.0 + number // 3, 900.0 + number // 3]
    return dict(zip(SIZES, sizes, strict=True)) | {"extents_mm": sorted(sizes, reverse=True)}


def _enlarge(item: dict[str, Any], factor: float, axes: Sequence[str] = SIZES) -> None:
    item.update({axis: item[axis] * factor for axis in axes})
    item["extents_mm"] = sorted((item[axis] for axis in SIZES), reverse=True)


def _other_source(content: Rows) -> None:
    for number, item in enumerate(_class(content, "swivel_chair.n.01")[:]):
        twin = dict(item, item_id=f"other:{number}", source="other", height_mm=item["height_mm"] * 1.8)
        content[ITEM].append(twin)


def _inches(content: Rows) -> None:
    """One class of four siblings written in inches, as `diningchair.csv` of 2020."""
    parent = _node(content, "chair.n.01")
    for name in ("armchair", "rocker", "recliner"):
        content[NODE].append(dict(_node(content, "mt:bar_stool"), node_id=f"{name}.n.01", name=name))
        for item in _class(content, "mt:bar_stool"):
            factor = 1 / 25.4 if name == "armchair" else 1.0
            twin = dict(item, node_id=f"{name}.n.01", item_id=f"{name}:{item['item_id']}")
            _enlarge(twin, factor)
            content[ITEM].append(twin)
    assert parent["level"] == 4


FAULTS: dict[str, Error] = {
    "E201": lambda content: content[NODE].append(dict(content[NODE][0], node_id="thing.n.01")),
    "E202": _orphan,
    "E203": _cycle,
    "E204": lambda content: content[NODE].append(dict(content[NODE][-1])),
    "E205": lambda content: _node(content, "mt:bar_stool").update(level=4),
    "E206": lambda content: content.update(
        {NODE: [r for r in content[NODE] if r["parent_id"] != "rodent_figure.n.01"]}
    ),
    "E207": lambda content: _node(content, "mt:bar_stool").update(path=["entity", "bar stool"]),
    "E208": lambda content: _node(content, "mt:bar_stool").update(pose="sideways"),
    "E209": lambda content: _node(content, "chair.n.01").update(n_items=3),
    "E210": _rename,
    "W211": _lone_child,
    "W212": lambda content: None,  # the mini tree has two mice
    "W213": _menu,
    "E301": _set(ITEM, 0, node_id="chair.n.01"),
    "E302": lambda content: content[ITEM].append(dict(content[ITEM][0])),
    "E303": _set(ITEM, 0, height_mm=2e7),
    "E304": _set(ITEM, 0, length_mm=500.0, width_mm=600.0),
    "E305": _set(ITEM, 0, kind="guess"),
    "E306": _set(ITEM, 0, licence=None),
    "E307": _set(ITEM, 0, length_mm=None, width_mm=None, height_mm=None, extents_mm=None),
    "W308": _resize("swivel_chair.n.01", _copies),
    "W309": lambda content: _enlarge(content[ITEM][0], 25.4),
    "W310": lambda content: _enlarge(content[ITEM][0], 5.0, ("height_mm",)),
    "W311": _resize("swivel_chair.n.01", lambda number, item: {"width_mm": 35.0}),
    "W312": _resize("mt:bar_stool", _grid),
    "W313": _other_source,
    "W314": _inches,
    "E401": _set(PRIOR, 0, node_id="throne.n.01"),
    "E402": _set(PRIOR, 0, weights=[0.7]),
    "E403": _set(PRIOR, 0, means=[[6.0, 6.0]]),
    "E404": _set(PRIOR, 0, covariances=[(-np.eye(3)).tolist()]),
    "E405": _set(PRIOR, 0, borrowed=1.5),
    "W406": lambda content: content[PRIOR].pop(0),
    "E501": lambda content: content["images.parquet"].append(_picture("made:nothing", None, "CC0-1.0")),
    "E502": lambda content: content["images.parquet"].append(
        _picture("made:mouse.n.01-0", "images/none.png", "CC0-1.0")
    ),
    "E503": lambda content: content["images.parquet"].append(_picture("made:mouse.n.01-0", None, None)),
    "E504": lambda content: content["images.parquet"].append(_picture("made:mouse.n.01-0", "nodes.parquet", "CC0-1.0")),
}


def _picture(item_id: str, path: str | None, licence: str | None) -> dict[str, Any]:
    return {"image_id": "0" * 64, "item_id": item_id, "node_id": "mouse.n.01", "path": path, "licence": licence}


def test_the_valid_release_has_no_error(tmp_path: Path) -> None:
    found = findings(minitree.release(tmp_path / "r").directory)
    assert {f.code for f in found} == {"W211", "W212", "W406"} - {"W406"} | {f.code for f in found if f.code == "W406"}
    assert not any(f.is_error for f in found)


@pytest.mark.parametrize("code", FAULTS)
def test_each_error_is_found_by_its_code(tmp_path: Path, code: str) -> None:
    content = minitree.rows()
    FAULTS[code](content)
    found = findings(minitree.release(tmp_path / "r", content).directory)
    assert code in {finding.code for finding in found}
    assert all("expected" in finding.message for finding in found)


def test_a_file_changed_after_publication_is_found(tmp_path: Path) -> None:
    directory = minitree.release(tmp_path / "r").directory
    data = bytearray((directory / ITEM).read_bytes())
    data[100] ^= 1
    (directory / ITEM).write_bytes(bytes(data))
    assert {f.code for f in findings(directory)} == {"E102"}


def test_a_missing_file_is_found(tmp_path: Path) -> None:
    directory = minitree.release(tmp_path / "r").directory
    (directory / ITEM).unlink()
    assert {f.code for f in findings(directory)} == {"E101"}


def test_a_column_of_another_type_is_found(tmp_path: Path) -> None:
    directory = minitree.release(tmp_path / "r").directory
    table = pq.read_table(directory / NODE)
    pq.write_table(table.set_column(4, "level", table["level"].cast(pa.string())), directory / NODE)
    manifest = (directory / MANIFEST).read_text()
    assert {f.code for f in findings(_resealed(directory, manifest))} == {"E104"}


def test_a_release_from_before_a_column_was_added_is_sound(tmp_path: Path) -> None:
    directory = minitree.release(tmp_path / "r").directory
    table = pq.read_table(directory / "images.parquet")
    pq.write_table(table.drop_columns(["attribution"]), directory / "images.parquet")
    manifest = (directory / MANIFEST).read_text()
    assert "E104" not in {f.code for f in findings(_resealed(directory, manifest))}


def test_rows_and_counts_of_the_manifest_are_held_against_the_tables(tmp_path: Path) -> None:
    def miscount(manifest: dict[str, Any]) -> None:
        manifest["counts"]["leaves"] = 99

    directory = minitree.release(tmp_path / "r", manifest=miscount).directory
    assert "E105" in {f.code for f in findings(directory)}
    table = pq.read_table(directory / ITEM)
    pq.write_table(table.slice(1), directory / ITEM)
    assert {f.code for f in findings(_resealed(directory, (directory / MANIFEST).read_text()))} == {"E103"}


def test_what_lies_beside_the_tables_is_held_against_its_checksum(tmp_path: Path) -> None:
    (tmp_path / "beside").mkdir()
    (tmp_path / "beside" / "README.md").write_text("sizes\n")
    directory = minitree.release(tmp_path / "r", extras=tmp_path / "beside").directory
    assert "E106" not in {f.code for f in findings(directory)}
    (directory / "README.md").unlink()
    assert "E106" in {f.code for f in findings(directory)}


def test_every_code_has_its_fixture() -> None:
    elsewhere = {"E101", "E102", "E103", "E104", "E105", "E106"}  # errors of files, above
    elsewhere |= {"W411", "W412", "W413", "W414", "W415"}  # tests/metric_tree/pipeline/test_leaf_findings.py
    assert set(CODES) == set(FAULTS) | elsewhere


def _resealed(directory: Path, manifest: str) -> Path:
    """The release with checksums and sizes of its current files, and otherwise the same manifest."""
    import json

    from metric_tree.release.release import sha256

    fields = json.loads(manifest)
    for name, recorded in fields["files"].items():
        recorded.update(sha256=sha256(directory / name), bytes=(directory / name).stat().st_size)
    (directory / MANIFEST).write_text(json.dumps(fields))
    return directory


def test_rows_that_state_extents_alone_are_no_copies(tmp_path: Path) -> None:
    def extents_alone(number: int, _: dict[str, Any]) -> dict[str, Any]:
        return dict.fromkeys(SIZES) | {"extents_mm": [900.0 + 3 * number, 600.0 + 2 * number, 500.0 + number]}

    content = minitree.rows()
    _resize("swivel_chair.n.01", extents_alone)(content)
    directory = minitree.release(tmp_path / "mini", content).directory
    assert "W308" not in {finding.code for finding in findings(directory)}


def _second_source(factor: float) -> Error:
    """Add a source of swivel chairs whose heights are the median times a factor."""

    def change(content: Rows) -> None:
        for number, item in enumerate(_class(content, "swivel_chair.n.01")[:]):
            item.update(height_mm=1000.0, extents_mm=None)
            content[ITEM].append(dict(item, item_id=f"other:{number}", source="other", height_mm=1000.0 * factor))

    return change


def _some_copies(copies: int) -> Error:
    """Give the last rows of the fourteen swivel chairs the sizes of the first."""

    def sizes(number: int, _: dict[str, Any]) -> dict[str, Any]:
        step = 0 if number >= 14 - copies else 11 * number
        values = [600.0 + step, 500.0 + step, 900.0 + step]
        return dict(zip(SIZES, values, strict=True)) | {"extents_mm": sorted(values, reverse=True)}

    return _resize("swivel_chair.n.01", sizes)


def _menu_of_sizes(lengths: int) -> Error:
    """Give twelve rows of a class every pair of some lengths and heights."""

    def change(content: Rows) -> None:
        kept = _class(content, "swivel_chair.n.01")[:12]
        content[ITEM] = [row for row in content[ITEM] if row["node_id"] != "swivel_chair.n.01"] + kept
        for number, item in enumerate(kept):
            values = [600.0 + 13.0 * (number % lengths) ** 2, 500.0, 900.0 + 17.0 * (number // lengths) ** 2]
            item.update(dict(zip(SIZES, values, strict=True)) | {"extents_mm": sorted(values, reverse=True)})

    return change


def _steps(error: float) -> Error:
    """Give the swivel chairs heights in steps of 10 mm, the last of which has an error."""

    def sizes(number: int, _: dict[str, Any]) -> dict[str, Any]:
        return {"length_mm": 600.0, "width_mm": 500.0, "height_mm": 900.0 + 10 * number + error * (number == 13)}

    return _resize("swivel_chair.n.01", sizes)


@pytest.mark.parametrize(
    ("code", "below", "above"),
    [
        ("W313", _second_source(1.49), _second_source(1.51)),
        ("W308", _some_copies(2), _some_copies(3)),  # 14 % and 21 % of the rows
        ("W312", _menu_of_sizes(2), _menu_of_sizes(3)),
        ("W312", _steps(0.012), _steps(0.008)),
        ("E303", _set(ITEM, 0, height_mm=4.9e6), _set(ITEM, 0, height_mm=5.1e6)),
        ("E303", _set(ITEM, 0, height_mm=0.011), _set(ITEM, 0, height_mm=0.009)),
        ("E303", _set(ITEM, 0, extents_mm=[4.9e6]), _set(ITEM, 0, extents_mm=[5.1e6])),
        ("E304", _set(ITEM, 0, extents_mm=[9.0, 9.000007]), _set(ITEM, 0, extents_mm=[9.0, 9.000012])),
        ("E304", _set(ITEM, 0, length_mm=9.0, width_mm=9.000007), _set(ITEM, 0, length_mm=9.0, width_mm=9.000012)),
        ("E307", _set(ITEM, 0, **dict.fromkeys(SIZES)), _set(ITEM, 0, **dict.fromkeys((*SIZES, "extents_mm")))),
    ],
)
def test_thresholds_of_the_checks_of_items(tmp_path: Path, code: str, below: Error, above: Error) -> None:
    for name, change, is_found in (("below", below, False), ("above", above, True)):
        content = minitree.rows()
        change(content)
        found = findings(minitree.release(tmp_path / name, content).directory)
        assert (code in {finding.code for finding in found}) == is_found, name


def _weights(excess: float) -> Error:
    return lambda content: content[PRIOR][0].update(
        weights=[weight * (1 + excess) for weight in content[PRIOR][0]["weights"]]
    )


def _eigenvalue(column: str, value: float) -> Error:
    """Give a covariance of the first prior a smallest eigenvalue."""

    def change(content: Rows) -> None:
        prior = content[PRIOR][0]
        matrix = np.diag([0.01] * (len(prior["dims"]) - 1) + [value]).tolist()
        prior[column] = matrix if column == "shared_covariance" else [matrix] * len(prior["weights"])

    return change


@pytest.mark.parametrize(
    ("code", "valid", "invalid"),
    [
        ("E402", _weights(0.9e-6), _weights(1.1e-6)),
        ("E402", _weights(-0.9e-6), _weights(-1.1e-6)),
        ("E404", _eigenvalue("covariances", 1.2e-12), _eigenvalue("covariances", 0.8e-12)),
        ("E404", _eigenvalue("shared_covariance", -0.8e-12), _eigenvalue("shared_covariance", -1.2e-12)),
        ("E405", _set(PRIOR, 0, family="lognormal-mixture"), _set(PRIOR, 0, family="normal")),
        (
            "E405",
            _set(PRIOR, 0, dims=["length", "width", "height"]),
            _set(PRIOR, 0, dims=["length", "depth", "height"]),
        ),
        ("E405", _set(PRIOR, 0, borrowed=0.5), _set(PRIOR, 0, dims=[])),
        ("E405", _set(PRIOR, 0, borrowed=1.0), _set(PRIOR, 0, borrowed=1.01)),
        ("E403", lambda _: None, _set(PRIOR, 0, means=[[6.0, 6.0], [6.0]])),
        ("E405", _set(PRIOR, 0, borrowed=0.0), _set(PRIOR, 0, borrowed=-0.01)),
    ],
)
def test_thresholds_of_the_checks_of_priors(tmp_path: Path, code: str, valid: Error, invalid: Error) -> None:
    for name, change, is_found in (("valid", valid, False), ("invalid", invalid, True)):
        content = minitree.rows()
        change(content)
        found = findings(minitree.release(tmp_path / name, content).directory)
        assert (code in {finding.code for finding in found}) == is_found, name


def test_a_prior_is_missing_for_a_node_with_items_and_without_a_prior(tmp_path: Path) -> None:
    content = minitree.rows()
    with_priors = {row["node_id"] for row in content[PRIOR]}
    node_id = content[PRIOR][0]["node_id"]
    found = findings(minitree.release(tmp_path / "whole", content).directory)
    before = {finding.subject for finding in found if finding.code == "W406"}
    assert not before & with_priors
    content[PRIOR].pop(0)
    found = findings(minitree.release(tmp_path / "without", content).directory)
    assert {finding.subject for finding in found if finding.code == "W406"} == before | {node_id}
    _node(content, node_id)["n_items"] = 0
    found = findings(minitree.release(tmp_path / "empty", content).directory)
    assert node_id not in {finding.subject for finding in found if finding.code == "W406"}


def _named(node_id: str, synset: str | None) -> Error:
    """Give the node of the bar stools another id and synset."""

    def change(content: Rows) -> None:
        _node(content, "mt:bar_stool").update(node_id=node_id, synset=synset)
        for row in content[ITEM] + content[PRIOR]:
            row["node_id"] = node_id if row["node_id"] == "mt:bar_stool" else row["node_id"]

    return change


@pytest.mark.parametrize(
    ("node_id", "synset", "is_found"),
    [
        ("mt:bar_stool", None, False),
        ("stool.n.01/other", None, False),
        ("bar_stool", None, True),
        ("bar_stool", "bar_stool.n.01", False),
    ],
)
def test_a_node_has_a_synset_or_the_id_of_an_insertion(
    tmp_path: Path, node_id: str, synset: str | None, is_found: bool
) -> None:
    content = minitree.rows()
    _named(node_id, synset)(content)
    found = findings(minitree.release(tmp_path / "r", content).directory)
    assert (node_id in {finding.subject for finding in found if finding.code == "W213"}) == is_found


@pytest.mark.parametrize(("dims", "is_found"), [(["height"], False), ([], False), (["depth"], True)])
def test_the_dimensions_of_a_node_are_axes_or_extents(tmp_path: Path, dims: list[str], is_found: bool) -> None:
    content = minitree.rows()
    _node(content, "mt:bar_stool").update(dims=dims)
    found = findings(minitree.release(tmp_path / "r", content).directory)
    assert any("dims: expected among length" in one.message for one in found if one.code == "E208") == is_found
