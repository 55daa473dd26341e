"""`metric-tree render`: images of a box whose every outline can be computed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import trimesh
from PIL import Image

from crawler.items import RawItem
from insertion.render.studio import AZIMUTHS_DEG, crop_to_object
from metric_cli.subcommands import main
from metric_tree.release.images import collect_images, image_record_files

# Published values, written out so that a changed rule fails a test.
ELEVATION_DEG = 20.0

LENGTH, WIDTH, HEIGHT = 1.0, 0.4, 0.7
ITEM = RawItem(source="open_models", source_id="box.glb", title="box", url="https://example.org/box", licence="CC0-1.0")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A model of a box, and its raw item."""
    box = trimesh.creation.box((LENGTH, HEIGHT, WIDTH))  # glTF: y is up
    (tmp_path / "models").mkdir()
    box.export(tmp_path / "models" / "box.glb")
    items = (replace(ITEM, attribution="Jane Doe"), replace(ITEM, source_id="logo.glb", flags=("trademark",)))
    (tmp_path / "items.jsonl").write_text("".join(f"{item.line()}\n" for item in items), encoding="utf-8")
    return tmp_path


def _run(folder: Path) -> int:
    return main(
        ["render", str(folder / "items.jsonl"), "--models", str(folder / "models"), "--out", str(folder), "--json"]
    )


def _outline_m(azimuth_deg: float) -> tuple[float, float]:
    """Width and height of the box's outline, metres, from an azimuth and the studio's elevation."""
    turn, rise = np.radians([azimuth_deg, ELEVATION_DEG])
    across = LENGTH * abs(np.cos(turn)) + WIDTH * abs(np.sin(turn))
    along = LENGTH * abs(np.sin(turn)) + WIDTH * abs(np.cos(turn))
    return across, HEIGHT * np.cos(rise) + along * np.sin(rise)


def test_a_box_has_its_outline_in_pixels(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run(folder) == 0
    assert json.loads(capsys.readouterr().out) == {"schema": "metric-tree/render/1", "items": 1, "pictures": 4}
    lines = (folder / "pictures-000001-000001.jsonl").read_text(encoding="utf-8").splitlines()
    for azimuth, line in zip(AZIMUTHS_DEG, lines, strict=True):
        record = json.loads(line)
        outline = np.array(_outline_m(azimuth)) * record["pixels_per_metre"]
        assert np.abs(outline - [record["width_px"], record["height_px"]]).max() < 2
        rgba = np.asarray(Image.open(folder / "pictures" / record["path"]))
        assert record["foreground_share"] == pytest.approx((rgba[..., 3] >= 128).mean(), abs=0.01)


def test_a_build_takes_them_as_their_own_cut_outs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run(folder) == 0
    items = pa.table({"item_id": ["open_models:box.glb"], "node_id": ["box.n.01"], "licence": ["CC0-1.0"]})
    rows = collect_images(image_record_files([folder / "items.jsonl"]), items, folder / "release").rows.to_pylist()
    assert 2 <= len(rows) <= 4  # a box may look the same from opposite sides, to the byte
    for row in rows:
        assert (row["method"], row["cutout_path"], row["attribution"]) == ("rendered", row["path"], "Jane Doe")
        assert (folder / "release" / row["path"]).is_file()


def test_a_folder_without_models_is_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "models" / "box.glb").unlink()
    assert _run(folder) == 2
    assert "expected models that the ids of" in capsys.readouterr().err


def test_wild_texture_coordinates_take_no_minutes() -> None:
    """Coordinates of one axis that run over hundreds of repeats: an anisotropic filter hangs on them in llvmpipe."""
    from insertion.render.gpu import gl_context
    from insertion.render.studio import studio_views
    from models3d.model import Material, Mesh, Model

    box = trimesh.creation.box((1, 1, 1))
    wild = np.column_stack([np.zeros(8), np.random.default_rng(0).uniform(-15, 275, 8)])
    texture = np.full((417, 500, 4), 200, np.uint8)
    part = Mesh(
        np.asarray(box.vertices),
        np.asarray(box.vertex_normals),
        wild,
        np.asarray(box.faces),
        Material(np.ones(4), base_texture=texture),
    )
    assert len(list(studio_views(gl_context(), Model("box", (part,)), 64))) == 4
    assert len(list(studio_views(gl_context(), Model("box", (part,)), 64, (0.0, 30.0)))) == 2


@pytest.mark.parametrize("last", [4, 5])
def test_a_crop_ends_with_the_last_pixel_that_is_not_clear(last: int) -> None:
    rgba = np.zeros((8, 9, 4), np.uint8)
    rgba[2 : last + 1, 3 : last + 1] = (50, 100, 25, 128)
    crop = crop_to_object(rgba)
    assert crop.shape == (last - 1, last - 2, 4)
    assert crop[0, 0].tolist() == [100, 199, 50, 128]  # without the alpha that was in its colours
    rgba[2, 3] = (99, 100, 120, 100)
    assert crop_to_object(rgba)[0, 0].tolist() == [252, 255, 255, 100]


def test_glass_is_drawn_once_over_what_is_solid() -> None:
    """A solid cube in a clear one of half alpha: where one looks past the solid, through a near side and a far one."""
    from insertion.render.gpu import gl_context
    from insertion.render.studio import studio_views
    from models3d.model import Material, Mesh, Model

    def cube(side: float, material: Material) -> Mesh:
        box = trimesh.creation.box((side, side, side))
        no_uv = np.zeros((8, 2))
        return Mesh(np.asarray(box.vertices), np.asarray(box.vertex_normals), no_uv, np.asarray(box.faces), material)

    clear = cube(1.0, Material(np.array([1.0, 1, 1, 0.5]), metallic=0.0, blend=True))
    solid = cube(0.5, Material(np.array([0.2, 0.2, 0.2, 1.0]), metallic=0.0))
    for parts in ((clear,), (clear, solid), (solid, clear)):
        view = next(iter(studio_views(gl_context(), Model("cubes", parts), 96)))
        alpha = view.rgba[..., 3].astype(int)
        middle = alpha[alpha.shape[0] // 2, alpha.shape[1] // 2]
        edge = np.median(alpha[alpha > 0])
        assert middle == (255 if len(parts) == 2 else edge)
        assert edge == pytest.approx(255 * 0.75, abs=2)


def test_views_are_a_quarter_turn_apart_and_oblique() -> None:
    """A box of 2 x 1, turned by 20 degrees, has the width 2 |cos| + |sin| of the azimuth less 20 degrees."""
    from insertion.render.gpu import gl_context
    from insertion.render.studio import studio_views
    from models3d.model import Material, Mesh, Model

    box = trimesh.creation.box((2, 1, 1))
    turn = trimesh.transformations.rotation_matrix(np.radians(20), [0, 1, 0])[:3, :3]
    corners, normals = (np.asarray(each) @ turn.T for each in (box.vertices, box.vertex_normals))
    part = Mesh(corners, normals, np.zeros((8, 2)), np.asarray(box.faces), Material(np.ones(4)))
    views = list(studio_views(gl_context(), Model("box", (part,)), 256))
    widths = [view.rgba.shape[1] / view.pixels_per_metre for view in views]
    assert widths == pytest.approx([2.143, 1.332, 2.143, 1.332], abs=0.03)
