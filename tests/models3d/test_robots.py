"""Robot and world descriptions: shapes, frames and what is refused, each in a file of a few elements."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from metric_base.errors import InputError
from models3d.asset import Asset
from models3d.formats import read_asset
from models3d.rescaling import write_at_scale

BOX = '<geom type="box" size="0.1 0.2 0.3"/>'


def _asset(folder: Path, text: str) -> Asset:
    (folder / "a.xml").write_text(text, encoding="utf-8")
    return read_asset(folder / "a.xml")


def _mjcf(folder: Path, body: str, head: str = "") -> Asset:
    return _asset(folder, f"<mujoco>{head}<worldbody>{body}</worldbody></mujoco>")


def _urdf(folder: Path, geometry: str, joints: str = "") -> Asset:
    link = f'<link name="a"><visual>{geometry}</visual></link>'
    return _asset(folder, f'<robot name="r">{link}{joints}</robot>')


def _sdf(folder: Path, geometry: str) -> Asset:
    visual = f"<visual><pose>0 0 1 0 0 0</pose>{geometry}</visual>"
    model = f'<model name="m"><pose>1 0 0 0 0 0</pose><link><pose>0 1 0 0 0 0</pose>{visual}</link></model>'
    return _asset(folder, f"<sdf>{model}<world>{model}</world></sdf>")


def _extents(asset: Asset) -> list[float]:
    (body,) = asset.bodies
    return np.round(body.extents_m, 6).tolist()


@pytest.mark.parametrize(
    ("rotation", "extents"),
    [
        ("", [0.2, 0.4, 0.6]),
        ('euler="90 0 0"', [0.2, 0.6, 0.4]),
        ('quat="0.70710678 0.70710678 0 0"', [0.2, 0.6, 0.4]),
        ('axisangle="0 0 2 90"', [0.4, 0.2, 0.6]),
        ('quat="1 0 0 0" euler="90 0 0"', [0.2, 0.4, 0.6]),  # the first of the two
    ],
)
def test_a_body_is_turned_by_each_form_of_a_rotation(tmp_path: Path, rotation: str, extents: list[float]) -> None:
    assert _extents(_mjcf(tmp_path, f"<body {rotation}>{BOX}</body>")) == extents
    assert _extents(_mjcf(tmp_path, f"<body><body {rotation}>{BOX}</body></body>")) == extents
    assert _extents(_mjcf(tmp_path, f"<body>{BOX[:-2]} {rotation}/></body>")) == extents


def test_angles_are_degrees_unless_the_compiler_states_radians(tmp_path: Path) -> None:
    body = f'<body euler="1.5707963 0 0">{BOX}</body>'
    assert _extents(_mjcf(tmp_path, body, '<compiler angle="radian"/>')) == [0.2, 0.6, 0.4]
    assert _extents(_mjcf(tmp_path, body, '<compiler angle="degree"/>')) != [0.2, 0.6, 0.4]


@pytest.mark.parametrize("name", ["xyaxes", "zaxis", "fromto"])
def test_other_rotations_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"orientation: expected quat, euler or axisangle, found {name}"):
        _mjcf(tmp_path, f'<body {name}="0 0 1">{BOX}</body>')


@pytest.mark.parametrize(
    ("geom", "extents"),
    [
        ('<geom type="sphere" size="0.2"/>', [0.4, 0.4, 0.4]),
        ('<geom size="0.2"/>', [0.4, 0.4, 0.4]),  # a sphere by default
        ('<geom type="ellipsoid" size="0.1 0.2 0.3"/>', [0.2, 0.4, 0.6]),
        ('<geom type="plane" size="9 9 9"/>' + BOX, [0.2, 0.4, 0.6]),  # a plane has no box
        ('<geom type="box"/>' + BOX, [0.2, 0.4, 0.6]),  # nor has a shape without a size
    ],
)
def test_a_body_has_the_boxes_of_its_shapes(tmp_path: Path, geom: str, extents: list[float]) -> None:
    assert _extents(_mjcf(tmp_path, f"<body>{geom}</body>")) == extents


def test_a_body_without_a_shape_is_omitted(tmp_path: Path) -> None:
    asset = _mjcf(tmp_path, f'<body name="a"/><body name="b">{BOX}</body>')
    assert [body.name for body in asset.bodies] == ["b"]
    with pytest.raises(InputError, match="at least one shape"):
        _mjcf(tmp_path, '<body name="a"/>')


@pytest.mark.parametrize(("n_bodies", "is_valid"), [(200, True), (201, False)])
def test_bodies_have_at_most_200_levels(tmp_path: Path, n_bodies: int, is_valid: bool) -> None:
    nested = "<body>" * n_bodies + BOX + "</body>" * n_bodies
    if is_valid:
        assert _extents(_mjcf(tmp_path, nested)) == [0.2, 0.4, 0.6]
    else:
        with pytest.raises(InputError, match="body: expected at most 200 levels"):
            _mjcf(tmp_path, nested)


def test_a_mesh_is_one_of_the_assets(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box([0.2, 0.4, 0.6]).export(tmp_path / "meshes" / "c.obj")
    head = '<compiler meshdir="meshes"/><asset><mesh name="c" file="c.obj" scale="1 1 2"/></asset>'
    assert _extents(_mjcf(tmp_path, '<body><geom mesh="c"/></body>', head)) == [0.2, 0.4, 1.2]
    with pytest.raises(InputError, match=r"geom\.mesh: expected a mesh of the assets"):
        _mjcf(tmp_path, '<body><geom mesh="d"/></body>', head)


SHAPES = [
    ("<box><size>0.2 0.4 0.6</size></box>", '<box size="0.2 0.4 0.6"/>', [0.2, 0.4, 0.6]),
    ("<sphere><radius>0.2</radius></sphere>", '<sphere radius="0.2"/>', [0.4, 0.4, 0.4]),
    (
        "<cylinder><radius>0.2</radius><length>0.6</length></cylinder>",
        '<cylinder radius="0.2" length="0.6"/>',
        [0.4, 0.4, 0.6],
    ),
    (
        "<capsule><radius>0.2</radius><length>0.6</length></capsule>",
        '<capsule radius="0.2" length="0.6"/>',
        [0.4, 0.4, 1.0],
    ),
]


@pytest.mark.parametrize(("sdf", "urdf", "extents"), SHAPES)
def test_shapes_have_their_boxes_in_both_forms(tmp_path: Path, sdf: str, urdf: str, extents: list[float]) -> None:
    assert _extents(_urdf(tmp_path, f"<geometry>{urdf}</geometry>")) == extents
    models = _sdf(tmp_path, f"<geometry>{sdf}</geometry>").bodies  # of the file and of its world
    assert len(models) == 2
    assert models[0].extents_m == pytest.approx(extents)
    assert (models[0].low_m + models[0].high_m) / 2 == pytest.approx([1, 1, 1])


@pytest.mark.parametrize("geometry", ["", "<geometry/>", "<geometry><plane/></geometry>"])
def test_a_visual_without_a_box_has_no_size(tmp_path: Path, geometry: str) -> None:
    for read in (_urdf, _sdf):
        with pytest.raises(InputError, match="at least one shape"):
            read(tmp_path, geometry)


@pytest.mark.parametrize(
    ("shape", "needed"), [("<box/>", "box: expected its size"), ("<sphere/>", "sphere: expected its radius")]
)
def test_a_shape_without_its_size_is_refused(tmp_path: Path, shape: str, needed: str) -> None:
    for read in (_urdf, _sdf):
        with pytest.raises(InputError, match=needed):
            read(tmp_path, f"<geometry>{shape}</geometry>")


def test_links_in_a_circle_are_refused(tmp_path: Path) -> None:
    joint = '<joint><parent link="{0}"/><child link="{1}"/></joint>'
    with pytest.raises(InputError, match="joint: expected links in no circle"):
        _urdf(tmp_path, '<geometry><box size="1 1 1"/></geometry>', joint.format("a", "b") + joint.format("b", "a"))


def test_lengths_of_a_robot_are_multiplied_and_angles_are_not(tmp_path: Path) -> None:
    asset = _mjcf(tmp_path, '<body><geom type="box" size="0.1 0.2 0.3" pos="1 0 0" euler="10 0 0"/></body>')
    write_at_scale(asset, tmp_path / "b.xml", 2.0)
    assert 'size="0.2 0.4 0.6" pos="2 0 0" euler="10 0 0"' in (tmp_path / "b.xml").read_text(encoding="utf-8")


def test_a_mesh_of_a_world_gets_a_scale_unless_it_has_one(tmp_path: Path) -> None:
    trimesh.creation.box([0.2, 0.4, 0.6]).export(tmp_path / "c.obj")
    mesh = "<geometry><mesh><uri>c.obj</uri>{}</mesh></geometry>"
    visuals = f"{mesh.format('')}</visual><visual>{mesh.format('<scale>1 1 3</scale>')}"
    write_at_scale(_sdf(tmp_path, visuals), tmp_path / "b.xml", 2.0)
    text = (tmp_path / "b.xml").read_text(encoding="utf-8")
    assert [text.count(part) for part in ("<scale>2 2 2</scale>", "<scale>2 2 6</scale>")] == [2, 2]
    assert "<pose>2 0 0 0 0 0</pose>" in text
