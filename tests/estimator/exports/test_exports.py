"""Reconstructions of other programs are the scene that COLMAP's files give, within a millionth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimator.reading import read_scene
from estimator.reconstructions.cameras import project
from estimator.records.scene import Scene, View
from metric_base.faults import InputFault
from tests.made.exports import EXPORTS, write_export
from tests.made.small_scene import small_model

PARAMS = {
    "SIMPLE_RADIAL": [300.0, 160.0, 120.0, 0.02],
    "OPENCV": [300.0, 290.0, 163.0, 117.0, 0.02, -0.01, 0.003, -0.002],
}


@pytest.fixture(scope="module", params=sorted(PARAMS))
def colmap(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("colmap")
    small_model(request.param, PARAMS[request.param]).write_binary(str(folder))
    return read_scene(folder)


def _rays(view: View) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Pixels of a fan of rays: what a camera model does, whatever it is called."""
    grid = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 7), np.linspace(-0.3, 0.3, 5)), axis=-1).reshape(-1, 2)
    return project(view.camera, np.column_stack([grid, np.ones(len(grid))]))


def check_same(colmap: Scene, other: Scene, program: str) -> None:
    names = {Path(view.name).name: view for view in other.views}
    size = float(np.ptp(colmap.points, axis=0).max())
    np.testing.assert_allclose(other.points, colmap.points, atol=1e-6 * size)
    assert len(other.views) == len(colmap.views)
    for view in colmap.views:
        same = names[Path(view.name).name]
        assert (same.camera.width, same.camera.height) == (view.camera.width, view.camera.height)
        np.testing.assert_allclose(same.rotation, view.rotation, atol=1e-6)
        np.testing.assert_allclose(same.centre, view.centre, atol=1e-6 * size)
        np.testing.assert_allclose(_rays(same), _rays(view), atol=1e-6 * 320)
        if program in {"bundler", "meshroom"}:
            order, own = np.argsort(same.point_index), np.argsort(view.point_index)
            np.testing.assert_array_equal(same.point_index[order], view.point_index[own])
            np.testing.assert_allclose(same.keypoints[order], view.keypoints[own], atol=1e-6 * 320)


@pytest.mark.parametrize("program", EXPORTS)
@pytest.mark.parametrize("by_file", [True, False])
def test_the_same_scene(program: str, by_file: bool, colmap: Scene, tmp_path: Path) -> None:
    if program in {"bundler", "realitycapture"} and colmap.views[0].camera.model == "OPENCV":
        pytest.skip("these state one focal length")
    file = write_export(colmap, program, tmp_path / program)
    scene = read_scene(file if by_file else file.parent)
    assert scene.format == program
    check_same(colmap, scene, program)
    observed = program in {"bundler", "meshroom"}
    assert any("projected" in line for line in scene.warnings) != observed
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
    with pytest.raises(InputFault, match=file.name) as fault:
        read_scene(file)
    assert "\n" not in str(fault.value)


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
    assert any("projected" in line for line in scene.warnings)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("cloud.ply", "name the folder with the cameras"),
        ("database.db", "colmap mapper"),
        ("a.zip", "unpack"),
        ("a.txt", "another kind"),
    ],
)
def test_a_file_in_place_of_a_folder_is_named_with_what_to_do(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputFault, match=words) as fault:
        read_scene(tmp_path / name)
    assert name in str(fault.value)
