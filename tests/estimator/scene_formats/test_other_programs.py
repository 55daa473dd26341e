"""Reconstructions of other programs are the scene that COLMAP's files give, within a millionth."""

from __future__ import annotations

import json
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.projection.cameras import project
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Scene
from estimator.scene_formats.common import brown_camera, pinhole_camera, posed_view
from estimator.scene_formats.meshroom import read_meshroom
from estimator.scene_formats.metashape import read_metashape
from estimator.scene_formats.nerfstudio import read_nerfstudio, read_normalisation
from metric_base.errors import FieldError, InputError
from tests.synthetic.exports import EXPORTS, OBSERVED, largest_difference, write_export, write_points
from tests.synthetic.small_scene import small_model

PARAMS = {
    "SIMPLE_RADIAL": [300.0, 160.0, 120.0, 0.02],
    "OPENCV": [300.0, 290.0, 163.0, 117.0, 0.02, -0.01, 0.003, -0.002],
}


@pytest.fixture(scope="module", params=sorted(PARAMS))
def colmap(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("colmap")
    small_model(request.param, PARAMS[request.param]).write_binary(str(folder))
    return read_scene(folder)


def assert_same_scene(colmap: Scene, other: Scene, program: str) -> None:
    assert largest_difference(colmap, other, observed=program in OBSERVED) < 1e-6


@pytest.mark.parametrize("program", EXPORTS)
@pytest.mark.parametrize("by_file", [True, False])
def test_the_same_scene(program: str, by_file: bool, colmap: Scene, tmp_path: Path) -> None:
    if program in {"bundler", "realitycapture"} and colmap.views[0].camera.model == "OPENCV":
        pytest.skip("these state one focal length")
    file = write_export(colmap, program, tmp_path / program)
    scene = read_scene(file if by_file else file.parent)
    assert scene.format == program
    assert_same_scene(colmap, scene, program)
    assert any("no observations" in line for line in scene.warnings) != (program in OBSERVED)
    assert all(len(view.point_index) for view in scene.views)


@pytest.mark.parametrize("program", EXPORTS)
def test_a_cut_file_is_one_line(program: str, colmap: Scene, tmp_path: Path) -> None:
    if program in {"bundler", "realitycapture"} and colmap.views[0].camera.model == "OPENCV":
        pytest.skip("written from the simple camera")
    file = write_export(colmap, program, tmp_path / program)
    data = file.read_bytes()
    file.write_bytes(
        data[: int(0.6 * len(data))].rpartition(b",")[0]
        if program == "realitycapture"
        else data[: int(0.6 * len(data))]
    )
    with pytest.raises(InputError, match=file.name) as error:
        read_scene(file)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("place", ["dense/sparse", "colmap/sparse/0", "dense/0/sparse"])
def test_colmap_in_other_places(place: str, colmap: Scene, tmp_path: Path) -> None:
    (tmp_path / place).mkdir(parents=True)
    assert colmap.model_path is not None
    for file in colmap.model_path.glob("*.bin"):
        (tmp_path / place / file.name).write_bytes(file.read_bytes())
    assert read_scene(tmp_path).model_path == tmp_path / place
    assert read_scene(tmp_path / place / "images.bin").model_path == tmp_path / place


def test_learned_reconstructions_state_no_observations(tmp_path: Path) -> None:
    """VGGT and MASt3R write COLMAP's text form with empty lines of keypoints."""
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 320 240 300 300 160 120\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 -0.1 0 0 1 b.png\n\n")
    (tmp_path / "points3D.txt").write_text("1 0 0 2 9 9 9 0\n2 0.1 0 2 9 9 9 0\n3 0 0 -2 9 9 9 0\n")
    scene = read_scene(tmp_path)
    assert [view.point_index.tolist() for view in scene.views] == [[0, 1], [0, 1]]
    assert any("no observations" in line for line in scene.warnings)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("cloud.ply", "name the folder with the cameras"),
        ("database.db", "colmap mapper"),
        ("a.zip", "unpack"),
        ("a.log", "another kind"),
    ],
)
def test_a_file_in_place_of_a_folder_is_named_with_what_to_do(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputError, match=words) as error:
        read_scene(tmp_path / name)
    assert name in str(error.value)


@given(
    st.floats(-0.15, 0.05),
    st.floats(-0.1, 0.1),
    st.floats(-0.05, 0.12),
    st.floats(-0.08, 0.02).filter(lambda k: k != 0),
)
@settings(max_examples=40)
def test_a_lens_with_four_radial_terms_is_followed_within_half_a_pixel(
    k1: float, k2: float, k3: float, k4: float
) -> None:
    """Metashape's and RealityCapture's k4, which COLMAP's models lack."""
    size, focal = (5280, 3956), 3705.0
    try:
        camera = brown_camera(
            size, (focal, focal), (2650.0, 1950.0), {"k1": k1, "k2": k2, "k3": k3, "k4": k4, "p1": -3e-4}
        )
    except FieldError:
        return  # it turns back on itself before the corner
    rays = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 9), np.linspace(-0.5, 0.5, 9)), axis=-1).reshape(-1, 2)
    r2 = (rays**2).sum(axis=1, keepdims=True)
    bent = rays * (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4)
    bent += -3e-4 * np.column_stack([2 * rays[:, 0] * rays[:, 1], r2[:, 0] + 2 * rays[:, 1] ** 2])
    wanted = focal * bent + [2650.0, 1950.0]
    inside = (wanted > 0).all(axis=1) & (wanted < size).all(axis=1)
    pixels = project(camera, np.column_stack([rays, np.ones(len(rays))]))
    assert np.abs(pixels[inside] - wanted[inside]).max() < 0.6


def test_a_lens_that_turns_back_before_the_corner_is_refused() -> None:
    with pytest.raises(FieldError, match="distortion"):
        brown_camera((4000, 3000), (2000.0, 2000.0), (2000.0, 1500.0), {"k1": -0.5, "k4": -0.1})


ODD = st.sampled_from([0.0, 1.0, -1.0, 1e300, -1e300, 1e-300, 1e3, 0.1])


@given(ODD, ODD.filter(bool), st.sampled_from([1e-300, 1.0, 2000.0, 1e300]), st.sampled_from([1e3, 1e300, -1e300]))
@settings(max_examples=60)
def test_odd_numbers_of_a_lens_give_a_camera_or_an_error(k1: float, k4: float, focal: float, centre: float) -> None:
    with np.errstate(all="raise", under="ignore"), suppress(FieldError):
        camera = brown_camera((2000, 1500), (focal, focal), (centre, 750.0), {"k1": k1, "k4": k4})
        assert np.isfinite(camera.params).all()


def test_a_chunk_without_components_has_its_own_transform(colmap: Scene, tmp_path: Path) -> None:
    """Metashape's files before components; the transform of the only component is then that of the chunk."""
    file = write_export(colmap, "metashape", tmp_path)
    text = file.read_text(encoding="utf-8")
    start, end = text.index("<components>"), text.index("</components>") + len("</components>")
    moved = text[text.index("<transform>", start) : text.index("</component>", start)]
    text = (text[:start] + text[end:]).replace(' component_id="0"', "").replace("</chunk>", f"{moved}</chunk>")
    file.write_text(text, encoding="utf-8")
    assert_same_scene(colmap, read_scene(file), "metashape")


def test_cameras_that_metashape_did_not_align_are_counted(colmap: Scene, tmp_path: Path) -> None:
    file = write_export(colmap, "metashape", tmp_path)
    text, n = file.read_text(encoding="utf-8"), len(colmap.views)
    assert any(f"1 of {n + 1} cameras are not aligned" in warning for warning in read_scene(file).warnings)
    start = text.index("<transform>", text.index("<camera "))
    end = text.index("</transform>", start) + len("</transform>")
    file.write_text(text[:start] + text[end:], encoding="utf-8")
    scene = read_scene(file)
    assert len(scene.views) == n - 1
    assert any(f"2 of {n + 1} cameras are not aligned" in warning for warning in scene.warnings)


def test_a_count_of_cameras_before_the_columns(tmp_path: Path) -> None:
    folder = tmp_path / "colmap"
    folder.mkdir()
    small_model("SIMPLE_RADIAL", PARAMS["SIMPLE_RADIAL"]).write_binary(str(folder))
    colmap = read_scene(folder)
    file = write_export(colmap, "realitycapture", tmp_path / "rc")
    file.write_text(f"#cameras {len(colmap.views)}\n{file.read_text(encoding='utf-8')}", encoding="utf-8")
    assert_same_scene(colmap, read_scene(file), "realitycapture")


@pytest.mark.parametrize(
    ("program", "words"),
    [("nerfstudio", "the COLMAP model"), ("meshroom", "ConvertSfMFormat"), ("metashape", "points.ply")],
)
def test_cameras_without_points_say_where_points_are(program: str, words: str, colmap: Scene, tmp_path: Path) -> None:
    """What instant-ngp and Meshroom's own cameras.sfm are."""
    file = write_export(colmap, program, tmp_path)
    for cloud in tmp_path.glob("*.ply"):
        cloud.unlink()
    if program == "meshroom":
        document = json.loads(file.read_text(encoding="utf-8"))
        del document["structure"]
        file.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        read_scene(file)
    write_points(tmp_path / "points.ply", colmap.points)
    assert len(read_scene(file).points) == len(colmap.points)


@pytest.mark.parametrize(("error", "is_valid"), [(0.0009, True), (0.0011, False)])
def test_a_rotation_is_orthogonal_to_a_thousandth(error: float, is_valid: bool) -> None:
    camera = pinhole_camera((640, 480), (500.0, 500.0), (320.0, 240.0), {})
    rotation = np.diag([np.sqrt(1 + error), 1.0, 1.0])
    with nullcontext() if is_valid else pytest.raises(FieldError, match="rotation"):
        posed_view("a", camera, rotation, np.zeros(3))


@pytest.mark.parametrize(("k1", "is_valid"), [(990.0, True), (1010.0, False)])
def test_a_distortion_coefficient_is_at_most_a_thousand(k1: float, is_valid: bool) -> None:
    with nullcontext() if is_valid else pytest.raises(FieldError, match="numbers up to 1000"):
        brown_camera((640, 480), (500.0, 500.0), (320.0, 240.0), {"k1": k1, "k4": 1e-9})


FISHEYE = [0.01, -0.002, 0.0003, 0.0001]


@pytest.mark.parametrize("kind", ["fisheye4", "equidistant"])
def test_a_fisheye_of_meshroom_has_four_coefficients(kind: str, colmap: Scene, tmp_path: Path) -> None:
    file = write_export(colmap, "meshroom", tmp_path)
    document = json.loads(file.read_text(encoding="utf-8"))
    for intrinsic in document["intrinsics"]:
        intrinsic.pop("type", None)
        intrinsic |= {"distortionType": kind, "distortionParams": FISHEYE}
    file.write_text(json.dumps(document), encoding="utf-8")
    camera = read_scene(file).views[0].camera
    assert camera.model == "OPENCV_FISHEYE"
    np.testing.assert_allclose(camera.params[4:], FISHEYE)
    for intrinsic in document["intrinsics"]:
        intrinsic["distortionParams"] = FISHEYE[:3]
    file.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match=f"type: expected one of .*{kind}"):
        read_scene(file)


@pytest.mark.parametrize(("value", "is_valid"), [(0.99e12, True), (1.01e12, False), (-1.01e12, False)])
@pytest.mark.parametrize("of", ["point", "pose"])
def test_coordinates_of_colmap_are_below_1e12(of: str, value: float, is_valid: bool, tmp_path: Path) -> None:
    far, near = f"{value} 0 2", "0 0 2"
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 320 240 300 300 160 120\n")
    (tmp_path / "images.txt").write_text(f"1 1 0 0 0 {far if of == 'pose' else near} 1 a.png\n\n")
    (tmp_path / "points3D.txt").write_text(f"1 {near} 9 9 9 0\n2 {far if of == 'point' else near} 9 9 9 0\n")
    with nullcontext() if is_valid else pytest.raises(InputError, match=rf"{of}.*finite (numbers|coordinates) below"):
        read_scene(tmp_path)


@pytest.mark.parametrize(
    ("program", "before", "after", "message"),
    [
        ("bundler", "# Bundle file v0.3", "# Bundle file v0.2", "header: expected # Bundle file v0.3"),
        ("meshroom", '"intrinsics": [', '"intrinsics": [], "others": [', "intrinsicId: expected an intrinsic"),
        ("metashape", "<document", "<!DOCTYPE a><document", "XML: expected a document without entities"),
        ("metashape", "<document", "<!ENTITY a><document", "XML: expected a document without entities"),
        ("metashape", "<chunk", "<other><chunk", "XML: expected a valid document"),
    ],
)
def test_a_document_without_what_it_needs_is_one_line(
    program: str, before: str, after: str, message: str, tmp_path: Path
) -> None:
    small_model("SIMPLE_RADIAL", PARAMS["SIMPLE_RADIAL"]).write_binary(str(tmp_path))
    file = write_export(read_scene(tmp_path), program, tmp_path / program)
    text = file.read_text(encoding="utf-8")
    assert before in text
    file.write_text(text.replace(before, after), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_scene(file)


def test_names_of_bundler_are_in_a_list(colmap: Scene, tmp_path: Path) -> None:
    if colmap.views[0].camera.model == "OPENCV":
        pytest.skip("written from the simple camera")
    file = write_export(colmap, "bundler", tmp_path)
    (names,) = tmp_path.glob("*list.txt")
    content = names.read_bytes()
    for name in ("list.txt", f"{file.stem}.list.txt", f"{file.name}.list.txt"):
        for other in tmp_path.glob("*list.txt"):
            other.unlink()
        with pytest.raises(InputError, match=r"images: expected their names in .*list\.txt"):
            read_scene(file)
        (tmp_path / name).write_bytes(content)
        assert_same_scene(colmap, read_scene(file), "bundler")
    (tmp_path / name).write_bytes(content + b"one_more.png\n")
    with pytest.raises(InputError, match=f"number of cameras: expected {len(colmap.views) + 1}, as many as the list"):
        read_scene(file)


@pytest.mark.parametrize(("determinant", "is_valid"), [(1.0, True), (-1.0, False)])
def test_a_mirrored_camera_is_refused(determinant: float, is_valid: bool) -> None:
    camera = pinhole_camera((640, 480), (500.0, 500.0), (320.0, 240.0), {})
    with nullcontext() if is_valid else pytest.raises(FieldError, match="rotation"):
        posed_view("a", camera, np.diag([1.0, 1.0, determinant]), np.zeros(3))


ANGLE_X, ANGLE_Y = 2 * np.arctan(320 / 500), 2 * np.arctan(240 / 600)
POSE = np.eye(4).tolist()


@pytest.mark.parametrize(
    ("entry", "camera"),
    [
        ({"fl_x": 500}, ("PINHOLE", 500, 500)),
        ({"fl_y": 500}, ("PINHOLE", 500, 500)),
        ({"fl_x": 500, "fl_y": 600}, ("PINHOLE", 500, 600)),
        ({"camera_angle_x": ANGLE_X}, ("PINHOLE", 500, 500)),
        ({"camera_angle_x": ANGLE_X, "camera_angle_y": ANGLE_Y}, ("PINHOLE", 500, 600)),
        ({"fl_x": 500, "k1": 0.1}, ("OPENCV", 500, 500)),
        ({"fl_x": 500, "is_fisheye": True}, ("OPENCV_FISHEYE", 500, 500)),
        ({"fl_x": 500, "camera_model": "OPENCV_FISHEYE"}, ("OPENCV_FISHEYE", 500, 500)),
        ({"fl_x": 500, "camera_model": "EQUIRECTANGULAR"}, "camera_model: expected OPENCV, OPENCV_FISHEYE or PINHOLE"),
        ({"camera_angle_y": ANGLE_Y}, "fl_x: expected a focal length, or camera_angle_x"),
        ({"fl_x": 500, "applied_transform": POSE[:3]}, ("PINHOLE", 500, 500)),
        ({"fl_x": 500, "applied_transform": np.eye(3, 4)[[1, 2, 0]].tolist()}, ("PINHOLE", 500, 500)),
        ({"fl_x": 500, "applied_transform": (2 * np.eye(3, 4)).tolist()}, "applied_transform: expected a rotation"),
    ],
)
def test_cameras_of_nerfstudio(entry: dict[str, Any], camera: tuple[str, int, int] | str, tmp_path: Path) -> None:
    document = {"w": 640, "h": 480, "frames": [{"file_path": "a.png", "transform_matrix": POSE}]} | entry
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    with nullcontext() if isinstance(camera, tuple) else pytest.raises(InputError, match=camera):
        (view,) = read_nerfstudio(tmp_path / "transforms.json").views
        assert (view.camera.model, *view.camera.params[:4]) == pytest.approx((*camera, 320, 240))


@pytest.mark.parametrize(
    ("position", "is_valid"), [((0.9e12, 0, 0), True), ((1.1e12, 0, 0), False), ((0, 0, -1.1e12), False)]
)
def test_a_camera_has_a_finite_position(position: tuple[float, ...], is_valid: bool) -> None:
    camera = pinhole_camera((640, 480), (500, 500), (320, 240), {})
    with nullcontext() if is_valid else pytest.raises(FieldError, match="pose: expected finite numbers below 1e"):
        posed_view("a", camera, np.eye(3), np.array(position))


@pytest.mark.parametrize("value", [2.1, -2.1, np.nan, np.inf])
def test_a_rotation_of_large_numbers_is_none(value: float) -> None:
    with pytest.raises(FieldError, match="pose: expected finite numbers below 1e"):
        posed_view("a", pinhole_camera((640, 480), (500, 500), (320, 240), {}), np.diag([1, 1, value]), np.zeros(3))


@pytest.mark.parametrize(
    ("scale", "factor", "is_valid"), [(2.0, 1, True), (0.0, 1, False), (-1.0, 1, False), (1.0, 2, False)]
)
def test_a_normalisation_is_a_similarity(scale: float, factor: float, is_valid: bool, tmp_path: Path) -> None:
    file = tmp_path / "dataparser_transforms.json"
    file.write_text(json.dumps({"scale": scale, "transform": (factor * np.eye(3, 4)).tolist()}))
    with nullcontext() if is_valid else pytest.raises(InputError, match="transform: expected a rotation and a shift"):
        assert read_normalisation(file)[0] == scale


SENSOR = """<sensor id="0" type="frame"><resolution width="640" height="480"/>
<calibration class="adjusted"><f>500</f><b2>0</b2></calibration></sensor>"""
COMPONENT = """<transform><rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>10 0 0</translation>
<scale>2</scale></transform>"""


def _metashape(folder: Path, before: str = "", after: str = "") -> Any:
    """Read an export of one camera at (1, 2, 3) of its component, with a part of the text exchanged."""
    text = f"""<document><chunk><sensors>{SENSOR}</sensors>
    <components><component id="0">{COMPONENT}</component></components>
    <cameras><camera label="a.png" sensor_id="0" component_id="0">
    <transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</transform></camera></cameras></chunk></document>"""
    assert before in text
    (folder / "a.xml").write_text(text.replace(before, after))
    return read_metashape(folder / "a.xml")


@pytest.mark.parametrize(
    ("before", "after", "centre"),
    [
        ("", "", (6, 2, 6)),
        ("<rotation>0 -1 0 1 0 0 0 0 1</rotation>", "", (12, 4, 6)),
        ("<translation>10 0 0</translation>", "", (-4, 2, 6)),
        ("<scale>2</scale>", "", (8, 1, 3)),
        (COMPONENT, "", (1, 2, 3)),
    ],
)
def test_a_component_of_metashape_has_a_transform(
    before: str, after: str, centre: tuple[float, ...], tmp_path: Path
) -> None:
    (view,) = _metashape(tmp_path, before, after).views
    assert view.centre == pytest.approx(centre)
    assert (view.camera.model, *view.camera.params) == ("PINHOLE", 500, 500, 320, 240)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('type="frame"', 'type="fisheye"', None),
        ('type="frame"', 'type="equidistant_fisheye"', None),
        ('type="frame"', 'type="spherical"', "sensor type: expected frame"),
        ('sensor_id="0"', 'sensor_id="9"', "sensor_id: expected a sensor of the file"),
        ('<resolution width="640" height="480"/>', "", "sensor: expected a resolution and an adjusted calibration"),
        ("<f>500</f>", "", "sensor: expected a resolution and an adjusted calibration"),
        ('width="640"', 'width="wide"', "resolution: expected whole numbers of pixels"),
        ("<b2>0</b2>", "<b2>0.49</b2>", None),
        ("<b2>0</b2>", "<b2>0.51</b2>", "b2: expected a skew under 0.001"),
        ("<b2>0</b2>", "<b2>-0.51</b2>", "b2: expected a skew under 0.001"),
        ("<scale>2</scale>", "<scale>0</scale>", "transform: expected a rotation, a scale above 0"),
    ],
)
def test_a_sensor_of_metashape(before: str, after: str, message: str | None, tmp_path: Path) -> None:
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        (view,) = _metashape(tmp_path, before, after).views
        assert view.camera.model == ("OPENCV_FISHEYE" if "fisheye" in after else "PINHOLE")


def test_an_export_of_metashape_has_a_chunk(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text("<document/>")
    with pytest.raises(InputError, match="document: expected a chunk with cameras"):
        read_metashape(tmp_path / "a.xml")


@pytest.mark.parametrize(
    ("intrinsic", "focal"),
    [
        ({"pxFocalLength": 500}, (500, 500)),
        ({"pxFocalLength": [500, 600]}, (500, 600)),
        ({"focalLength": 25, "sensorWidth": 32}, (500, 500)),
        ({"focalLength": 25, "sensorWidth": 32, "pixelRatio": 1.2}, (500, 600)),
    ],
)
def test_focal_lengths_of_meshroom(intrinsic: dict[str, Any], focal: tuple[int, int], tmp_path: Path) -> None:
    """An observation of a view without a pose is ignored."""
    pose = {"transform": {"rotation": np.eye(3).ravel().tolist(), "center": [0, 0, 0]}}
    seen = [{"observationId": view, "x": [3, 4]} for view in ("1", "2")]
    document = {
        "version": ["1", "2", "1"],
        "intrinsics": [{"intrinsicId": "7", "width": 640, "height": 480} | intrinsic],
        "poses": [{"poseId": "1", "pose": pose}],
        "views": [{"viewId": name, "poseId": name, "intrinsicId": "7", "path": f"/{name}.png"} for name in ("1", "2")],
        "structure": [{"X": [0, 0, 5], "observations": seen}],
    }
    (tmp_path / "cameras.sfm").write_text(json.dumps(document))
    (view,) = read_meshroom(tmp_path / "cameras.sfm").views
    assert view.camera.params == pytest.approx([*focal, 320, 240])
    assert (view.keypoints.tolist(), view.point_index.tolist()) == ([[3, 4]], [0])


@pytest.mark.parametrize(("k4", "is_read"), [(0.01, True), (0.05, True), (0.3, False), (-0.02, False)])
def test_a_distortion_of_degree_eight_is_approximated_or_refused(k4: float, is_read: bool) -> None:
    """The error of 0.3 is 20 times MAX_FIT_ERROR; the polynomial of -0.02 turns back within the image."""
    distortion = {"k1": -0.2, "k4": k4}
    with nullcontext() if is_read else pytest.raises(FieldError, match=r"k4: expected|a polynomial that reaches"):
        assert brown_camera((640, 480), (500.0, 500.0), (320.0, 240.0), distortion).model == "FULL_OPENCV"
