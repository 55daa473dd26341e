"""Models in every format: their extents, the verdict on them, and the file at true size."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import metric_tree
from metric_base.errors import InputError
from metric_base.files import sole_writer
from metric_cli.subcommands import main
from models3d.asset import Asset, AssetBody, NameText
from models3d.formats import read_asset, read_assets
from models3d.rescaling import write_at_scale
from models3d.size_check.category import category_of_texts
from models3d.size_check.check import check_bodies
from models3d.size_check.hypotheses import hypotheses
from models3d.size_check.size_model import size_model
from models3d.size_check.true_size import model_true_size
from tests.models3d.models import CHAIR, chair, write_chair

TREE = metric_tree.open()
FORMATS = [
    "glb",
    "gltf",
    "obj",
    "stl",
    "ascii.stl",
    "ply",
    "ascii.ply",
    "off",
    "dae",
    "usda",
    "usdz",
    "urdf",
    "mjcf",
    "sdf",
]
#: A robot whose mesh is outside its folder.
LEADS_OUT = (
    b'<robot name="r"><link name="l"><visual><geometry><mesh filename="../../x.stl"/></geometry></visual></link>'
    b"</robot>"
)
#: Formats whose chair stands along z.
Z_UP = {"urdf", "mjcf", "sdf"}


@pytest.mark.parametrize("ending", FORMATS)
def test_extents_in_metres_from_every_format(tmp_path: Path, ending: str) -> None:
    asset = read_asset(write_chair(tmp_path, ending))
    expected = CHAIR[[0, 2, 1]] if ending in Z_UP else CHAIR
    whole = np.ptp([corner for body in asset.bodies for corner in (body.low_m, body.high_m)], axis=0)
    np.testing.assert_allclose(whole, expected, rtol=1e-4)


@pytest.mark.parametrize("ending", [one for one in FORMATS if one != "off"])
def test_a_slip_of_the_unit_is_found_and_mended(tmp_path: Path, ending: str) -> None:
    path = write_chair(tmp_path, ending, 100.0)
    (check,) = check_bodies(read_asset(path), TREE, "chair")
    assert (check.verdict, check.factor) == ("wrong unit", pytest.approx(0.01))
    before = path.read_bytes()
    fixed = path.with_name(f"fixed{path.suffix}")
    write_at_scale(read_asset(path), fixed, 0.01)
    (after,) = check_bodies(read_asset(fixed), TREE, "chair")
    assert after.verdict == "right"
    assert path.read_bytes() == before


def test_all_but_the_size_stays_as_it_was(tmp_path: Path) -> None:
    path = write_chair(tmp_path, "glb", 100.0)
    write_at_scale(read_asset(path), tmp_path / "fixed.glb", 0.01)
    header, chunk = path.read_bytes(), (tmp_path / "fixed.glb").read_bytes()
    start = 20 + int.from_bytes(header[12:16], "little")
    assert header[start:] in chunk  # the binary chunk, to the byte
    dae = write_chair(tmp_path, "dae", 100.0)
    write_at_scale(read_asset(dae), tmp_path / "fixed.dae", 0.01)
    assert len((tmp_path / "fixed.dae").read_bytes()) - len(dae.read_bytes()) < 60  # one unit


def test_baked_vertices_need_no_node(tmp_path: Path) -> None:
    path = write_chair(tmp_path, "glb", 100.0)
    write_at_scale(read_asset(path), tmp_path / "baked.glb", 0.01, baked=True)
    loaded = trimesh.load(tmp_path / "baked.glb", force="scene")
    np.testing.assert_allclose(next(iter(loaded.geometry.values())).extents, CHAIR, rtol=1e-5)
    with pytest.raises(InputError, match="expected a glTF file"):
        write_at_scale(read_asset(write_chair(tmp_path, "stl")), tmp_path / "x.stl", 0.01, baked=True)


def test_nothing_is_written_over_the_input_or_away_from_what_it_names(tmp_path: Path) -> None:
    path = write_chair(tmp_path, "urdf", 100.0)
    with pytest.raises(InputError, match="another file than the input"):
        write_at_scale(read_asset(path), path, 0.01)
    (tmp_path / "other").mkdir()
    with pytest.raises(InputError, match="the same folder"):
        write_at_scale(read_asset(path), tmp_path / "other" / "chair.urdf", 0.01)
    assert list((tmp_path / "other").iterdir()) == []


@pytest.mark.parametrize(
    ("factor", "verdict"), [(1.0, "right"), (0.001, "wrong unit"), (1000.0, "wrong unit"), (39.37, "wrong unit")]
)
def test_verdicts(factor: float, verdict: str) -> None:
    (check,) = check_bodies(_asset(CHAIR * factor), TREE, "chair")
    assert check.verdict == verdict
    assert check.probability > 0.6


def test_a_normalised_mesh_has_an_arbitrary_scale() -> None:
    (check,) = check_bodies(_asset(np.array([0.08, 0.12, 0.05]) / 0.12, centred=True), TREE, "mug")
    assert check.verdict == "arbitrary scale"
    assert check.true_size is not None
    low, median, high = check.true_size.height_m
    assert low < 0.12 < high < 3 * median


def test_a_lying_wardrobe_is_turned() -> None:
    (check,) = check_bodies(_asset(np.array([1.0, 0.6, 2.1])), TREE, "wardrobe")
    assert check.verdict == "turned"


def test_what_the_file_calls_it() -> None:
    words = [
        NameText("file name", "SM_OfficeChair_01_LOD0"),
        NameText("material", "red wood"),
        NameText("node", "Cube.003"),
    ]
    category = category_of_texts(words, TREE)
    assert category.node is not None
    assert "chair" in category.node.name
    assert category.source == "file name"
    doubtful = category_of_texts(
        [NameText("node", "table"), NameText("node", "lamp"), NameText("node", "elephant")], TREE
    )
    assert doubtful.node is None
    assert len(doubtful.others) == 3
    assert category_of_texts([NameText("node", "zzqx 17")], TREE).node is None


def test_a_scene_is_judged_body_by_body(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(chair(), node_name="chair")
    lamp = trimesh.creation.box((0.3, 150.0, 0.3))
    lamp.apply_translation((5, 75, 0))
    scene.add_geometry(lamp, node_name="floor lamp")
    scene.export(tmp_path / "room.glb")
    checks = {check.body: check for check in check_bodies(read_asset(tmp_path / "room.glb"), TREE)}
    assert checks["chair"].verdict == "right"
    assert set(checks) == {"chair", "floor lamp"}
    assert checks["floor lamp"].is_wrong


@given(st.floats(-9, 9), st.lists(st.floats(-4, 3), min_size=3, max_size=3))
@settings(max_examples=40, deadline=None)
def test_probabilities_are_a_distribution_and_follow_the_scale(shift: float, sides: list[float]) -> None:
    model = size_model(TREE.find("chair").prior(), None)
    body = AssetBody("b", np.zeros(3), np.exp(np.array(sides) + shift))
    all_of_them = hypotheses(body, "y", model)
    assert sum(one.probability for one in all_of_them) == pytest.approx(1)
    assert all(np.isfinite(one.probability) for one in all_of_them)


def test_the_true_size_of_a_generated_mesh(tmp_path: Path) -> None:
    path = write_chair(tmp_path, "obj", 1 / 0.86)
    answer = model_true_size(read_asset(path), "chair", TREE)
    assert answer.factor[0] < 0.86 < answer.factor[2]
    assert answer.factor[2] / answer.factor[0] < 3
    with pytest.raises(InputError, match="no node is called"):
        model_true_size(read_asset(path), "qwertz", TREE)


@pytest.mark.parametrize(
    ("name", "content", "line"),
    [
        ("a.glb", b"glTF\x02\x00\x00\x00", "content"),
        ("a.gltf", b'{"asset": {"version": "2.0"}, "nodes": [{"children": [1]}, {"children": [0]}]}', "nodes"),
        ("a.obj", b"f 1 2 3\n", "content"),
        ("a.stl", b"solid x\nendsolid x\n", "content"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 900000000\nproperty float x\nend_header\n", "content"),
        ("a.dae", b"<COLLADA/>", "content"),
        ("a.usda", b"#usda 1.0\ndef {", "content"),
        ("a.urdf", LEADS_OUT, "mesh"),
        ("a.urdf", b'<!DOCTYPE r [<!ENTITY a "aaaa">]><robot>&a;</robot>', "content"),
        ("a.xml", b"<html/>", "content"),
        ("a.gltf", b'{"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "scene": 7, "nodes": [{}]}', "content"),
        ("b.gltf", b'{"asset": {"version": "2.0"}, "nodes": [{"mesh": 0, "skin": 0}], "meshes": [{}]}', "content"),
        ("a.blend", b"BLENDER", "file"),
    ],
)  # fmt: skip
def test_bad_files_are_one_line(tmp_path: Path, name: str, content: bytes, line: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=line) as caught:
        read_asset(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_that_ends_its_reader_ends_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sound = write_chair(tmp_path, "stl")
    outcomes = list(read_assets([sound, tmp_path / "missing.glb", sound]))
    assert [isinstance(one, Asset) for _, one in outcomes] == [True, False, True]


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    right, wrong = write_chair(tmp_path, "glb"), write_chair(tmp_path, "stl", 1000.0)
    assert main(["check-asset", str(right)]) == 0
    assert "right (p = " in capsys.readouterr().out
    assert main(["check-asset", str(right), str(wrong), "--json", "--report", str(tmp_path / "page.html")]) == 3
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["verdict"] for row in rows] == ["right", "wrong unit"]
    assert rows[1]["schema"] == "metric-tree/asset/1"
    assert "<svg" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert main(["true-size", str(right), "--category", "chair", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["factor"]["low"] < 1


def test_a_table_of_boxes_goes_on_where_it_stopped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "boxes.csv"
    table.write_text("name,x,y,z\nchair,0.5,0.9,0.5\noffice chair,50,110,50\nmug,0.1,0.1,0.08\n", encoding="utf-8")
    out = tmp_path / "out.jsonl"
    assert main(["check-asset", "--batch", str(table), "--up", "y", "--out", str(out)]) == 3
    lines = out.read_text(encoding="utf-8").split("\n")
    out.write_text("\n".join(lines[:2]) + "\n", encoding="utf-8")
    main(["check-asset", "--batch", str(table), "--up", "y", "--out", str(out)])
    assert out.read_text(encoding="utf-8").split("\n") == lines
    table.write_text("name,x,y,z\nchair,0.5,nan,0.5\n", encoding="utf-8")
    assert main(["check-asset", "--batch", str(table)]) == 2
    assert "boxes.csv:2: x, y, z: expected sizes in metres" in capsys.readouterr().err


def test_a_list_goes_on_after_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    """An unreadable file before the stop moves nothing, and half a line of a kill is written again."""
    names = ["broken.glb", *(write_chair(tmp_path, kind, 1000.0).name for kind in ("stl", "obj"))]
    (tmp_path / "broken.glb").write_bytes(b"glTF")
    listed, out = tmp_path / "list.txt", tmp_path / "out.jsonl"
    listed.write_text("".join(f"{name}\n" for name in names))
    words = ["check-asset", "--batch", str(listed), "--category", "chair", "--out", str(out)]
    assert main(words) == 3
    whole = out.read_text(encoding="utf-8")
    assert whole.count("\n") == 2
    out.write_text(whole[: whole.index("\n") + 40], encoding="utf-8")
    main(words)
    assert out.read_text(encoding="utf-8") == whole
    assert main([*words[:-2], "--fix", str(tmp_path / "fixed")]) == 3
    assert sorted(file.name for file in (tmp_path / "fixed").iterdir()) == sorted(names[1:])


def _list_of_wrong_chairs(folder: Path) -> list[str]:
    """Write three chairs in millimetres; return the words of a command that checks and fixes them."""
    for name in "abc":
        (folder / name).mkdir()
        write_chair(folder / name, "stl", 1000.0)
    out, fix = str(folder / "out.jsonl"), str(folder / "fixed")
    return ["check-asset", *(str(folder / name) for name in "abc"), "--category", "chair", "--out", out, "--fix", fix]


def test_a_model_is_done_only_after_its_fix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = _list_of_wrong_chairs(tmp_path)

    def interrupt(asset: Asset, *arguments: object, **options: object) -> None:
        if asset.file.parent.name == "b":
            raise KeyboardInterrupt
        write_at_scale(asset, *arguments, **options)  # type: ignore[arg-type]

    with monkeypatch.context() as patches:
        patches.setattr("models3d.rescaling.write_at_scale", interrupt)
        assert main(command) == 130
    assert (tmp_path / "out.jsonl").read_text(encoding="utf-8").count("\n") == 1
    assert main(command) == 3
    assert (tmp_path / "out.jsonl").read_text(encoding="utf-8").count("\n") == 3
    assert {file.name for file in (tmp_path / "fixed").iterdir()} == {"chair.stl", "chair-2.stl", "chair-3.stl"}


def test_a_finished_list_has_the_same_status_and_report_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, out = tmp_path / "boxes.csv", tmp_path / "out.jsonl"
    table.write_text("name,x,y,z\nchair,48,86,52\noffice chair,50,110,50\nchair,0.48,0.86,0.52\n", encoding="utf-8")
    command = ["check-asset", "--batch", str(table), "--up", "y", "--out", str(out), "--overwrite"]
    command += ["--report", str(tmp_path / "page.html")]
    pages = []
    for _ in range(2):
        assert main(command) == 3
        pages.append((tmp_path / "page.html").read_bytes())
    assert b"3 models, 2 of them wrong" in pages[0]
    assert pages[0] == pages[1]
    assert main(command[:-2]) == 3
    assert "wrong unit        2" in capsys.readouterr().out
    assert out.read_text(encoding="utf-8").count("\n") == 3


def test_two_runs_do_not_write_the_same_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with sole_writer(tmp_path / "out.jsonl"):
        assert main(["check-asset", str(tmp_path), "--out", str(tmp_path / "out.jsonl")]) == 2
    assert "another run is writing this output" in capsys.readouterr().err
    assert not (tmp_path / "out.jsonl").exists()


@pytest.mark.parametrize("line", ["{", "5", '{"schema": "metric-tree/asset/1"}', "[" * 100_000, "\xff"])
def test_a_damaged_line_of_results_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str) -> None:
    out = tmp_path / "out.jsonl"
    before = (
        b'{"schema": "metric-tree/asset/1", "file": "a.glb", "verdict": "right"}\n' + line.encode("latin-1") + b"\n"
    )
    out.write_bytes(before)
    assert main(["check-asset", str(tmp_path), "--out", str(out)]) == 2
    assert "out.jsonl" in (message := capsys.readouterr().err)
    assert "internal error" not in message
    assert out.read_bytes() == before


def test_a_model_that_cannot_be_written_does_not_stop_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a").mkdir()
    bound, free = write_chair(tmp_path / "a", "urdf", 1000.0), write_chair(tmp_path, "stl", 1000.0)
    fix = tmp_path / "fixed"
    assert main(["check-asset", str(bound), str(free), "--category", "chair", "--fix", str(fix)]) == 2
    assert "the model refers to other files" in capsys.readouterr().err
    assert [file.name for file in fix.iterdir()] == ["chair.stl"]


def test_names_that_are_not_utf_8_or_move_the_cursor_are_escaped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_chair(tmp_path, "glb", 1000.0).rename(tmp_path / "a\x1b[2J\u202e\udcff.glb")
    command = ["check-asset", str(path), "--category", "chair", "--out", str(tmp_path / "out.jsonl")]
    assert main([*command, "--report", str(tmp_path / "page.html")]) == 3
    assert main([*command[:-2], "--json"]) == 3
    shown = capsys.readouterr().out
    assert r"a\x1b[2J\u202e\udcff.glb" in shown
    assert not {"\x1b", "\u202e", "\udcff"} & set(shown)
    rows = (tmp_path / "out.jsonl").read_text(encoding="utf-8").splitlines()
    assert [json.loads(row)["file"] for row in rows] == [str(path)]


def test_boxes_cannot_be_written_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "boxes.csv").write_text("name,x,y,z\noffice chair,50,110,50\n")
    assert main(["check-asset", "--batch", str(tmp_path / "boxes.csv"), "--fix", str(tmp_path / "out")]) == 2
    assert "expected models to write anew" in capsys.readouterr().err


def _asset(extents: np.ndarray, *, centred: bool = False) -> Asset:
    low = -extents / 2 if centred else np.zeros(3)
    return Asset(Path("model.glb"), "gltf", 1.0, "y", (AssetBody("model", low, low + extents),))
