"""Thresholds of the check of model sizes: an example on each side of every one that decides a verdict."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
import trimesh

import metric_tree
from metric_base.errors import InputError
from metric_cli.subcommands import main
from models3d import rescaling
from models3d.asset import Asset, AssetBody, NameText, merge_bodies
from models3d.formats import read_asset
from models3d.size_check import check as size_check
from models3d.size_check.category import NamedCategory, category_of_texts
from models3d.size_check.check import AssetCheck, check_bodies
from models3d.size_check.report import write_report
from tests.models3d.models import CHAIR

TREE = metric_tree.open()


def _check(extents: Iterable[float], category: str = "chair") -> AssetCheck:
    high = np.array(list(extents))
    body = AssetBody("model", np.zeros(3), high)
    (check,) = check_bodies(Asset(Path("model.glb"), "gltf", 1.0, "y", (body,)), TREE, category)
    return check


def _probability(check: AssetCheck, *kinds: str) -> float:
    return sum(row.probability for row in check.hypotheses if row.kind in kinds)


def test_a_scale_is_wrong_from_a_probability_of_60_percent() -> None:
    near = {True: 1.0, False: 1.0}
    for factor in np.geomspace(1.2, 6.0, 120):
        check = _check(CHAIR * factor)
        wrong = 1 - _probability(check, "right", "unlike")
        stretched = _probability(check, "stretched")
        rotated = sum(row.probability for row in check.hypotheses if row.kind == "right" and row.is_rotated)
        if stretched > 0.3 or rotated > 0.5:
            continue
        assert check.is_wrong == (wrong >= 0.6)
        near[check.is_wrong] = min(near[check.is_wrong], abs(wrong - 0.6))
    assert max(near.values()) < 0.1  # the series comes close to the threshold on both sides


def test_a_side_is_stretched_from_a_probability_of_95_percent() -> None:
    near = {True: 1.0, False: 1.0}
    for factor in np.geomspace(1.5, 10.0, 150):
        check = _check(CHAIR * [1, 1, factor])
        stretched = _probability(check, "stretched")
        others = max(_probability(check, kind) for kind in ("unit", "arbitrary", "miniature"))
        if stretched < max(others, 0.6):
            continue
        assert (check.verdict == "stretched") == (stretched >= 0.95)
        near[stretched >= 0.95] = min(near[stretched >= 0.95], abs(stretched - 0.95))
    assert max(near.values()) < 0.05


def test_a_model_is_turned_from_a_probability_of_80_percent() -> None:
    near = {True: 1.0, False: 1.0}
    for height in np.linspace(0.3, 1.9, 200):
        check = _check([1.0, height, 2.1], "wardrobe")
        rotated = sum(row.probability for row in check.hypotheses if row.kind == "right" and row.is_rotated)
        if 1 - _probability(check, "right", "unlike") >= 0.55:
            continue
        assert (check.verdict == "turned") == (rotated >= 0.8)
        near[rotated >= 0.8] = min(near[rotated >= 0.8], abs(rotated - 0.8))
    assert max(near.values()) < 0.1


@pytest.mark.parametrize(
    ("texts", "named"),
    [
        # a fraction of 0.563 and of 0.541, on both sides of 0.55
        ([("file name", "chair"), ("node", "lamp"), ("node", "Lamp 2")], True),
        ([("file name", "chair"), ("node", "lamp"), ("node", "Lamp 2"), ("node", "LAMP")], False),
        # a weight of 0.3 and of 0.2, on both sides of 0.3
        ([("comment", "chair")], True),
        ([("material", "chair")], False),
    ],
)
def test_a_category_needs_most_votes_and_a_strong_one(texts: list[tuple[str, str]], named: bool) -> None:
    category = category_of_texts([NameText(*text) for text in texts], TREE)
    assert (category.node is not None) == named


def test_a_vote_for_a_broad_category_supports_its_subcategories() -> None:
    texts = [NameText("node", "chair"), NameText("node", "dining chair"), NameText("material", "lamp")]
    category = category_of_texts(texts, TREE)
    assert category.node is not None
    assert category.node.name == "dining chair"


@pytest.mark.parametrize(("overlap", "n_objects"), [(0.04, 2), (0.06, 1)])
def test_objects_that_overlap_are_one(overlap: float, n_objects: int) -> None:
    low = CHAIR * (1 - overlap)
    bodies = (
        AssetBody("chair", np.zeros(3), CHAIR, (NameText("node", "chair"),)),
        AssetBody("lamp", low, low + CHAIR, (NameText("node", "floor lamp"),)),
    )
    assert len(check_bodies(Asset(Path("a.glb"), "gltf", 1.0, "y", bodies), TREE)) == n_objects


@pytest.mark.parametrize(("offset", "is_centred"), [(0.004, True), (0.006, False)])
def test_a_box_is_centred_within_half_a_percent(offset: float, is_centred: bool) -> None:
    sides = np.array([1.0, 0.5, 0.2])
    shift = np.array([0.0, offset, 0.0])
    assert AssetBody("b", shift - sides / 2, shift + sides / 2).is_centred == is_centred


def test_hypotheses_are_listed_from_a_probability_of_one_percent() -> None:
    near = []
    for factor in np.linspace(1.2, 2.4, 13):
        check = _check(CHAIR * factor)
        listed = [row["probability"] for row in check.to_json()["hypotheses"]]
        probabilities = [row.probability for row in check.hypotheses]
        assert listed == [round(p, 4) for p in probabilities if p >= 0.01]
        near += [p for p in probabilities if 0.005 < p < 0.02]
    assert min(near) < 0.01 < max(near)


def test_strict_also_fails_for_unknown_categories(tmp_path: Path) -> None:
    folder = tmp_path / "qq"
    folder.mkdir()
    file = folder / "zzqx.stl"
    trimesh.creation.box(CHAIR).export(file)
    assert main(["check-asset", str(file)]) == 0
    assert main(["check-asset", str(file), "--strict"]) == 3


def test_a_report_draws_what_is_not_right(tmp_path: Path) -> None:
    checks = [_check(CHAIR), _check(CHAIR * 1000), _check([0.0, 0.0, 0.0])]
    write_report(tmp_path / "page.html", checks)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 1
    assert "3 models, 1 of them wrong" in page
    assert page.index("wrong unit") < page.index("right (p")


@pytest.mark.parametrize(("source", "named"), [("mesh", True), ("folder", False)])
def test_an_ignored_word_lowers_the_weight_of_a_text(source: str, named: bool) -> None:
    """0.7 of 0.6 and of 0.4, on both sides of the minimum weight of 0.3; a folder with the bare name has 0.4."""
    assert (category_of_texts([NameText(source, "chair zzqx")], TREE).node is not None) == named
    assert category_of_texts([NameText(source, "chair")], TREE).node is not None


@pytest.mark.parametrize(("error", "is_written"), [(0.5e-3, True), (5e-3, False)])
def test_a_rescaled_file_is_read_again_and_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: float, is_written: bool
) -> None:
    file, out = tmp_path / "chair.stl", tmp_path / "out.stl"
    trimesh.creation.box(CHAIR).export(file)
    wrong = merge_bodies(read_asset(file).bodies, "").extents_m * 2 * (1 + error)
    written = Asset(out, "stl", None, None, (AssetBody("chair", np.zeros(3), wrong),))
    monkeypatch.setattr(rescaling, "read_assets", lambda files, read: iter([(read(files[0]).file, written)]))
    if is_written:
        rescaling.write_at_scale(read_asset(file), out, 2.0)
    else:
        with pytest.raises(InputError, match="when the file is read again"):
            rescaling.write_at_scale(read_asset(file), out, 2.0)
    assert out.exists() == is_written


@pytest.mark.parametrize(("kind", "height"), [("cylinder", 0.6), ("capsule", 0.8)])
def test_a_capsule_has_caps_beyond_its_length(tmp_path: Path, kind: str, height: float) -> None:
    file = tmp_path / "robot.xml"
    geom = f'<geom type="{kind}" size="0.1 0.3"/>'
    file.write_text(f'<mujoco><worldbody><body name="b">{geom}</body></worldbody></mujoco>', encoding="utf-8")
    (body,) = read_asset(file).bodies
    assert body.extents_m == pytest.approx([0.2, 0.2, height])


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_a_ply_file_may_have_elements_before_its_vertices(tmp_path: Path, form: str) -> None:
    header = f"ply\nformat {form} 1.0\nelement camera 1\nproperty float focal\nelement vertex 3\n"
    header += "property float x\nproperty float y\nproperty float z\n"
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    corners = np.array([[0, 0, 0], [0.5, 0, 0], [0, 1.5, 0.25]], dtype="<f4")
    if form == "ascii":
        body = "\n".join(["35.0", *(" ".join(map(str, row)) for row in corners.tolist()), "3 0 1 2", ""]).encode()
    else:
        body = np.float32(35).tobytes() + corners.tobytes() + b"\3" + np.array([0, 1, 2], dtype="<i4").tobytes()
    file, out = tmp_path / "a.ply", tmp_path / "b.ply"
    file.write_bytes(header.encode() + body)
    rescaling.write_at_scale(read_asset(file), out, 2.0)
    assert merge_bodies(read_asset(out).bodies, "").extents_m == pytest.approx([1.0, 3.0, 0.5])
    assert out.read_bytes().count(b"35.0" if form == "ascii" else np.float32(35).tobytes()) == 1


@pytest.mark.parametrize(("n_before", "is_named"), [(59, True), (60, False)])
def test_sixty_texts_of_a_file_are_read(n_before: int, is_named: bool) -> None:
    texts = [NameText("node", f"zzqx{'abcdefghij'[k % 10]}{'klmnopqrst'[k // 10]}") for k in range(n_before)]
    assert (category_of_texts([*texts, NameText("node", "chair")], TREE).node is not None) == is_named


@pytest.mark.parametrize(("text", "is_named"), [("chair" + " zz" * 5, False), ("zz " * 110 + "chair", False)])
def test_ignored_words_and_a_long_text_name_no_category(text: str, is_named: bool) -> None:
    assert (category_of_texts([NameText("semantic", text)], TREE).node is not None) == is_named


@pytest.mark.parametrize(("n_blanks", "is_named"), [(115, True), (116, False)])
def test_120_characters_of_a_text_are_read(n_blanks: int, is_named: bool) -> None:
    assert (category_of_texts([NameText("node", " " * n_blanks + "chair")], TREE).node is not None) == is_named


def test_four_other_categories_are_listed() -> None:
    names = ["chair", "floor lamp", "wardrobe", "bottle", "piano", "bicycle"]
    category = category_of_texts([NameText("node", name) for name in names], TREE)
    assert (category.node, len(category.others)) == (None, 4)


@pytest.mark.parametrize(("height", "words"), [(0.099, "99 mm high"), (0.12, "0.12 m high")])
def test_a_report_states_lengths_under_ten_centimetres_in_millimetres(
    tmp_path: Path, height: float, words: str
) -> None:
    write_report(tmp_path / "page.html", [_check([0.05, height, 0.05])])
    assert words in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_a_report_has_200_drawings(tmp_path: Path) -> None:
    write_report(tmp_path / "page.html", [_check(CHAIR * 1000)] * 201)
    assert (tmp_path / "page.html").read_text(encoding="utf-8").count("<svg") == 200


@pytest.mark.parametrize(("pair", "n_objects"), [(("198", "199"), 1), (("199", "200"), 201)])
def test_the_first_200_objects_of_a_scene_are_compared(
    pair: tuple[str, str], n_objects: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MAX_OBJECTS: objects that overlap are one."""
    bodies = tuple(AssetBody(str(k), np.zeros(3), np.ones(3)) for k in range(201))
    monkeypatch.setattr(size_check, "category_of_texts", lambda *_: NamedCategory(TREE.find("chair"), "name", 1.0))
    monkeypatch.setattr(size_check, "check_body", lambda _, body, *__: body)
    monkeypatch.setattr(AssetBody, "overlaps", lambda one, other: (one.name, other.name) == pair)
    assert len(check_bodies(Asset(Path("model.glb"), "gltf", 1.0, "y", bodies), TREE, None)) == n_objects
