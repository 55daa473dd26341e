"""Readers of model files: damaged files, limits, and the effect of a failure on other files."""

from __future__ import annotations

import base64
import csv
import json
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from metric_base.errors import FieldError, InputError
from metric_cli.subcommands import main
from models3d import formats
from models3d.asset import Asset
from models3d.formats import read_asset, read_assets, read_boxes
from models3d.gltf import document
from models3d.gltf.document import GltfWriter
from models3d.gltf.model_reader import read_model
from models3d.rescaling import write_at_scale
from models3d.usd import reader
from tests.models3d.models import USDA, write_chair


def _gltf(path: Path, **fields: object) -> Path:
    path.write_text(json.dumps({"asset": {"version": "2.0"}, **fields}), encoding="utf-8")
    return path


def _fail_on_bad(path: Path) -> Asset:
    if path.name == "bad.stl":
        raise TypeError("an error of a reader")
    return read_asset(path)


def test_primitives_that_are_a_number_do_not_stop_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = _gltf(tmp_path / "bad.gltf", nodes=[{"mesh": 0}], meshes=[{"primitives": 5}])
    good = write_chair(tmp_path, "glb")
    assert main(["check-asset", str(bad), str(good), "--category", "chair"]) == 2
    out, err = capsys.readouterr()
    assert f"{bad}: content: expected" in err
    assert "internal error" not in err
    assert "right (p = " in out


def test_primitives_of_a_mesh_that_no_node_draws_are_checked(tmp_path: Path) -> None:
    writer = GltfWriter("test")
    corners = writer.add_accessor(np.eye(3))
    writer.add("meshes", {"primitives": [{"attributes": {"POSITION": corners}}]})
    writer.add("meshes", {"primitives": 5})
    file = tmp_path / "a.glb"
    file.write_bytes(writer.to_bytes([writer.add("nodes", {"mesh": 0})]))
    with pytest.raises(InputError, match="expected a readable glTF"):
        read_model(file)


def test_external_files_that_are_too_large_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_chair(tmp_path, "gltf")
    buffer = next(file for file in tmp_path.iterdir() if file.suffix == ".bin")
    monkeypatch.setattr(document, "MAX_BYTES", 20_000)
    assert read_model(path).meshes
    buffer.write_bytes(buffer.read_bytes() + b"\0" * 20_000)
    with pytest.raises(InputError, match=r"expected at most [\d,]+ bytes") as caught:
        read_model(path)
    assert "readable glTF" not in str(caught.value)


def test_an_error_of_a_reader_does_not_affect_other_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    good = write_chair(tmp_path, "stl")
    (tmp_path / "bad.stl").write_bytes(good.read_bytes())
    monkeypatch.setattr(formats, "read_asset", _fail_on_bad)
    results = [result for _, result in read_assets([tmp_path / "bad.stl", good])]
    assert isinstance(results[0], InputError)
    assert "found a file that ends its reader" in str(results[0])
    assert isinstance(results[1], Asset)


def test_a_file_that_takes_too_long_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(formats, "MAX_SECONDS", 1e-3)
    ((_, result),) = read_assets([write_chair(tmp_path, "stl")])
    assert "found more than 0.001 s" in str(result)


@pytest.mark.parametrize("shape", ["<sphere/>", '<cylinder length="1"/>', "<box/>", '<sphere radius="nan"/>'])
def test_a_shape_without_its_size_is_named(tmp_path: Path, shape: str) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(f'<robot name="r"><link name="l"><visual><geometry>{shape}</geometry></visual></link></robot>')
    with pytest.raises(InputError, match=r"r\.urdf: .*expected"):
        read_asset(path)


def test_a_comment_before_a_shape_is_ignored(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    shape = '<!-- half --><box size="1 2 3"/>'
    path.write_text(f'<robot name="r"><link name="l"><visual><geometry>{shape}</geometry></visual></link></robot>')
    assert read_asset(path).bodies[0].extents_m.tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("ending", "refers"), [("glb", False), ("gltf", True), ("stl", False), ("urdf", True), ("sdf", False)]
)
def test_files_that_refer_to_others_are_marked(tmp_path: Path, ending: str, refers: bool) -> None:
    assert read_asset(write_chair(tmp_path, ending)).has_external_files == refers


def test_fix_reads_a_file_only_within_the_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The reader of this process fails, that of the separate process does not."""
    path = write_chair(tmp_path, "glb", 100.0)
    monkeypatch.setattr(document.GltfDocument, "open", None)
    out = tmp_path / "fixed.glb"
    assert main(["check-asset", str(path), "--category", "chair", "--fix", str(out)]) == 3
    assert out.exists()


def test_odd_files_of_a_folder_are_named_and_the_others_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_chair(tmp_path, "glb")
    _gltf(tmp_path / "a.gltf", scenes=[{"nodes": [0]}], nodes=[{"name": "chair"}])
    (tmp_path / "b.obj").write_text("v 0 0 0\nv 1e308 0 0\nv 0 1e308 1\nf 1 2 3\n")
    (tmp_path / "c.usda").write_text(USDA.format(unit=1e308))
    assert main(["check-asset", str(tmp_path), "--category", "chair"]) == 2
    out, err = capsys.readouterr()
    assert [line.partition(": expected")[0].rpartition("/")[2] for line in err.splitlines()] == [
        "a.gltf: content",
        "b.obj: vertices",
        "c.usda: vertices",
    ]
    assert "right (p = " in out


@pytest.mark.parametrize("size", ["1e308", "-1", "nan", "", "2e15"])
def test_odd_row_of_a_table_does_not_stop_the_rows_after_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], size: str
) -> None:
    table = tmp_path / "boxes.csv"
    table.write_text(f"name,x,y,z\nchair,{size},{size},{size}\nchair,48,86,52\n", encoding="utf-8")
    assert main(["check-asset", "--batch", str(table), "--up", "y"]) == 3
    out, err = capsys.readouterr()
    assert "boxes.csv:2: x, y, z: expected sizes in metres" in err
    assert "boxes.csv:3: wrong unit" in out


@pytest.fixture
def usual_field_limit() -> Iterator[None]:
    """Python's limit of a field of a CSV table, which the importers of data sets raise."""
    before = csv.field_size_limit(131_072)
    yield
    csv.field_size_limit(before)


@pytest.mark.usefixtures("usual_field_limit")
def test_field_of_a_table_that_no_reader_holds_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "boxes.csv"
    table.write_text(f"name,x,y,z\nchair,0.5,0.9,0.5\n{'a' * 200_000},1,1,1\n", encoding="utf-8")
    assert main(["check-asset", "--batch", str(table)]) == 2
    assert "boxes.csv: file: expected a table of boxes, found field larger than field limit" in capsys.readouterr().err


def test_parquet_tables_are_read_in_batches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    columns = {"name": ["chair"] * 7, **{axis: [1.0] * 7 for axis in "xyz"}, "other": [["a"] * 9] * 7}
    pq.write_table(pa.table(columns), tmp_path / "boxes.parquet")
    monkeypatch.setattr(formats, "N_BATCH_ROWS", 2)
    assert len(list(formats.read_boxes(tmp_path / "boxes.parquet"))) == 7
    (tmp_path / "boxes.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"boxes\.parquet: file: expected a table of boxes"):
        list(formats.read_boxes(tmp_path / "boxes.parquet"))


def _usdz(file: Path, **members: str) -> Path:
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("chair.usda", USDA.format(unit=100.0))
        for name, text in members.items():
            archive.writestr(name, text)
    return file


@pytest.mark.parametrize("name", ["../victim.usda", "{folder}/victim.usda", "a/../../victim.usda"])
def test_a_package_cannot_change_or_include_files_outside_it(tmp_path: Path, name: str) -> None:
    victim = tmp_path / "victim.usda"
    victim.write_text(USDA.format(unit=1.0), encoding="utf-8")
    (tmp_path / "in").mkdir()
    package = _usdz(tmp_path / "in" / "chair.usdz", **{name.format(folder=tmp_path): USDA.format(unit=7.0)})
    out = tmp_path / "in" / "fixed.usdz"
    with pytest.raises(InputError, match=r"package: expected names of files inside the package"):
        write_at_scale(read_asset(package), out, 0.01)
    assert victim.read_text(encoding="utf-8") == USDA.format(unit=1.0)
    assert sorted(file.name for file in tmp_path.rglob("*") if file.is_file()) == ["chair.usdz", "victim.usda"]


def test_a_package_that_unpacks_to_more_than_the_limit_is_not_unpacked(tmp_path: Path) -> None:
    package = _usdz(tmp_path / "chair.usdz", image="a" * 100)
    with zipfile.ZipFile(package, "a") as archive:
        archive.infolist()[1].file_size = 1 << 30  # as a bomb states it
        archive.writestr("b", "b")  # writes the directory anew
    with pytest.raises(InputError, match=r"package: expected at most 536870912 bytes unpacked"):
        write_at_scale(read_asset(package), tmp_path / "fixed.usdz", 0.01)


def test_a_package_may_refer_to_its_own_files_only(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    reference = 'defaultPrim = "Chair"'
    part = USDA.format(unit=1.0)
    inner = f"#usda 1.0\n(\n    {reference}\n    subLayers = [@./part.usda@]\n)\n"
    outer = inner.replace("./part.usda", str(tmp_path / "part.usda"))
    (tmp_path / "part.usda").write_text(part, encoding="utf-8")
    for name, root in (("good", inner), ("bad", outer)):
        with zipfile.ZipFile(tmp_path / "in" / f"{name}.usdz", "w") as archive:
            archive.writestr("root.usda", root)
            archive.writestr("part.usda", part)
    assert not read_asset(tmp_path / "in" / "good.usdz").has_external_files
    with pytest.raises(InputError, match="reference: expected a file in the folder of the model"):
        read_asset(tmp_path / "in" / "bad.usdz")


def test_a_fix_has_the_limits_of_reading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_chair(tmp_path, "glb", 100.0)
    asset = read_asset(path)
    monkeypatch.setattr(formats, "MAX_SECONDS", 0.0)
    with pytest.raises(InputError, match=r"chair\.glb: file: expected a model that can be read, found more than 0 s"):
        write_at_scale(asset, tmp_path / "fixed.glb", 0.01)
    assert list(tmp_path.iterdir()) == [path]


def _doubling(folder: Path, levels: int, arc: str) -> Path:
    """Write a stage of 2 ** levels cubes, each prim with two references to the next, in files or in one layer."""
    head = '#usda 1.0\n(\n    defaultPrim = "P0"\n    metersPerUnit = 1\n)\n'
    prims = []
    for level in range(levels + 1):
        target = {"file": f"references = @./p{level + 1}.usda@</P{level + 1}>", "class": f"inherits = </P{level + 1}>"}
        inner = "".join(f'    def "{name}" (\n        {target[arc]}\n    )\n    {{\n    }}\n' for name in "ab")
        cube = '    def Cube "c"\n    {\n        double size = 1\n    }\n'
        prims.append(f'def Xform "P{level}"\n{{\n{inner if level < levels else cube}}}\n')
    texts = [head + prim for prim in prims] if arc == "file" else [head + "".join(prims)]
    for level, text in enumerate(texts):
        (folder / f"p{level}.usda").write_text(text, encoding="utf-8")
    return folder / "p0.usda"


@pytest.mark.parametrize("arc", ["file", "class"])
def test_references_that_double_are_refused_before_they_are_composed(tmp_path: Path, arc: str) -> None:
    """The limit is a million prims: 2 ** 20 and more are refused; 2 ** 8 are read."""
    with pytest.raises(InputError, match="references: expected at most 1,000,000 prims, found more"):
        read_asset(_doubling(tmp_path, 20, arc))
    assert len(read_asset(_doubling(tmp_path, 8, arc)).bodies) > 0


def test_the_limit_of_prims(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A prim counts 1 + 2 * (1 + count of the next), and the last one 2: 37 with three levels."""
    path = _doubling(tmp_path, 3, "file")
    monkeypatch.setattr(reader, "MAX_COMPOSED_PRIMS", 37)
    assert read_asset(path).bodies
    monkeypatch.setattr(reader, "MAX_COMPOSED_PRIMS", 36)
    with pytest.raises(InputError, match="at most 36 prims"):
        read_asset(path)


@pytest.mark.parametrize(("metres", "is_valid"), [(0.99e15, True), (1.01e15, False)])
def test_coordinates_and_sizes_are_at_most_1e15_metres(metres: float, is_valid: bool, tmp_path: Path) -> None:
    mesh = tmp_path / "a.obj"
    mesh.write_text(f"v 0 0 0\nv {metres} 0 0\nv 0 1 0\nf 1 2 3\n")
    with nullcontext() if is_valid else pytest.raises(InputError, match="coordinates of at most 1e"):
        assert read_asset(mesh).bodies[0].high_m[0] == pytest.approx(metres)
    table = tmp_path / "a.csv"
    table.write_text(f"name,x,y,z\na,1,1,{metres}\n")
    (row,) = read_boxes(table)
    assert isinstance(row, Asset) == is_valid


def _png(width: int, height: int) -> str:
    """Return a data URI of the header of a PNG, in which readers find the size before they decode pixels."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    data += struct.pack(">I", 9) + b"IDAT"
    return "data:image/png;base64," + base64.b64encode(data).decode()


@pytest.mark.parametrize(
    ("sizes", "message"),
    [
        ([(8192, 8192)], None),
        ([(8192, 8193)], "at most 67,108,864 pixels, found '67,117,056'"),
        ([(8192, 8192)] * 2, None),
        ([(8192, 8192), (8192, 8191), (8192, 2)], "at most 134,217,728 pixels in all, found '134,225,920'"),
    ],
)
def test_textures_have_at_most_8192_x_8192_pixels_and_twice_as_many_in_all(
    sizes: list[tuple[int, int]], message: str | None, tmp_path: Path
) -> None:
    images = [{"uri": _png(*size)} for size in sizes]
    opened = document.GltfDocument.open(_gltf(tmp_path / "a.gltf", images=images))
    with nullcontext() if message is None else pytest.raises(FieldError, match=message):
        opened.check_images()


@pytest.mark.parametrize(
    ("nodes", "count", "mode", "message"),
    [
        (3, 1_000_000, 4, None),
        (3, 1_000_001, 4, "at most 3000000 vertices, found 3000003"),
        (1, 6_000_000, 4, "at most 3000000 vertices"),
        (2, 1_000_002, 5, "at most 2000000 triangles, found 2000004"),
        (2, 1_000_000, 5, None),
        (1, 6_000_001, 0, "count: expected a whole number from 1 to 6000000"),
    ],
)
def test_corners_and_triangles_are_counted_for_each_node_that_draws_them(
    nodes: int, count: int, mode: int, message: str | None, tmp_path: Path
) -> None:
    accessors = [{"count": count, "componentType": 5126, "type": "VEC3"}]
    meshes = [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}]
    path = _gltf(tmp_path / "a.gltf", accessors=accessors, meshes=meshes, nodes=[{"mesh": 0}] * nodes)
    with nullcontext() if message is None else pytest.raises(FieldError, match=message):
        document.GltfDocument.open(path)


@pytest.mark.parametrize(("n_nodes", "is_valid"), [(100_000, True), (100_001, False)])
def test_a_file_has_at_most_100000_nodes(n_nodes: int, is_valid: bool, tmp_path: Path) -> None:
    path = _gltf(tmp_path / "a.gltf", nodes=[{}] * n_nodes)
    with nullcontext() if is_valid else pytest.raises(FieldError, match="nodes: expected at most 100000"):
        document.GltfDocument.open(path)


@pytest.mark.parametrize(("n_nodes", "is_valid"), [(501, True), (502, False)])
def test_nodes_are_at_most_500_levels_below_a_root(n_nodes: int, is_valid: bool, tmp_path: Path) -> None:
    nodes = [{"children": [index + 1]} for index in range(n_nodes - 1)]
    path = _gltf(tmp_path / "a.gltf", nodes=[*nodes, {}])
    with nullcontext() if is_valid else pytest.raises(FieldError, match="at most 500 levels"):
        document.GltfDocument.open(path)


@pytest.mark.parametrize(("metres", "is_valid"), [(0.99e9, True), (1.01e9, False)])
def test_a_corner_of_a_model_is_at_most_a_million_kilometres_away(
    metres: float, is_valid: bool, tmp_path: Path
) -> None:
    writer = GltfWriter("test")
    corners = writer.add_accessor(np.array([[0, 0, 0], [metres, 0, 0], [0, metres, 0]], dtype=np.float32))
    mesh = writer.add("meshes", {"primitives": [{"attributes": {"POSITION": corners}}]})
    (tmp_path / "a.glb").write_bytes(writer.to_bytes([writer.add("nodes", {"mesh": mesh})]))
    with nullcontext() if is_valid else pytest.raises(InputError, match="POSITION: expected finite numbers below"):
        assert read_model(tmp_path / "a.glb").meshes


@pytest.mark.parametrize(("name", "found"), [("folder.glb", "a folder"), ("none.glb", "none")])
def test_a_model_is_a_file(name: str, found: str, tmp_path: Path) -> None:
    (tmp_path / "folder.glb").mkdir()
    with pytest.raises(InputError, match=rf"expected a glTF file \(\.glb or \.gltf\); found {found}"):
        read_model(tmp_path / name)
