"""The benchmark of absolute scale on predictions with known scores."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.absolute_scale import (
    Prediction,
    main,
    read_predictions,
    scene_folders,
    table,
    true_scale,
    write_figure,
)
from benchmarks.public_sets import MIN_CAMERAS, true_centres
from estimator.reconstructions.scene_reader import read_scene
from metric_base.errors import InputError
from tests.synthetic.small_scene import small_model

TRUTHS = {"a": 2.0, "b": 0.5}


def rows_of(text: str) -> dict[str, list[str]]:
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()[2:]]
    return {line[0]: line[1:] for line in lines}


def test_scores(tmp_path: Path) -> None:
    file = tmp_path / "predictions.csv"
    file.write_text("scene,scale,low,high,seconds\na,2.2,1.8,2.4,3\nb,0.6,0.55,0.7,5\n", encoding="utf-8")
    rows = rows_of(table(list(read_predictions(f"mine={file}", list(TRUTHS), [])), TRUTHS))
    score = (math.log(2.4 / 1.8) + math.log(0.7 / 0.55) + 20 * math.log(0.55 / 0.5)) / 2
    error = (math.log(1.1) + math.log(1.2)) / 2
    assert rows == {"mine": ["2", "0", "15.0", "15.0", f"{error:.3f}", "0.50", f"{score:.2f}", "4.0"]}


def test_a_missing_scene_is_a_refusal_and_tuned_scenes_are_apart(tmp_path: Path) -> None:
    file = tmp_path / "predictions.csv"
    file.write_text("scene,scale,low,high\na,2.0,,\n", encoding="utf-8")
    rows = rows_of(table(list(read_predictions(f"mine={file}", list(TRUTHS), ["mine=a"])), TRUTHS))
    assert rows["mine"] == ["1", "1", "–", "–", "–", "–", "–", "–"]
    assert rows["mine (scenes seen)"] == ["1", "0", "0.0", "0.0", "0.000", "–", "–", "–"]


@pytest.mark.parametrize("row", ["a,x,,", "a,-1,,", "a,2,3,4", "a,2,1,1.5", "a,inf,,"])
def test_invalid_predictions(row: str, tmp_path: Path) -> None:
    file = tmp_path / "predictions.csv"
    file.write_text(f"scene,scale,low,high\n{row}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"predictions.csv:2"):
        list(read_predictions(f"mine={file}", list(TRUTHS), []))


def test_figure(tmp_path: Path) -> None:
    write_figure(
        [Prediction("mine", "a", 2.2, 1.8, 2.4, 1.0), Prediction("x", "b", 0.5, None, None, None)],
        TRUTHS,
        tmp_path / "a.png",
    )
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_scenes_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    assert "demo_room\t" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--tuned-on", "other=demo_room"], "--tuned-on: value: expected NAME=SCENE .*found 'other=demo_room'"),
        (["--tuned-on", "mine=nowhere"], "--tuned-on: value: expected NAME=SCENE .*found 'mine=nowhere'"),
        (["--predictions", "mine"], "--predictions: value: expected NAME=FILE, found 'mine'"),
        (["--predictions", "mine=missing.csv"], "missing.csv: expected a table"),
    ],
)
def test_invalid_options_are_one_line(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("right.csv").write_text("scene,scale,low,high\ndemo_room,1,,\n", encoding="utf-8")
    assert main(["--only-predictions", "--predictions", "mine=right.csv", *words]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scene,scale,low\ndemo_room,1,\n", "header: expected columns scene, scale, low, high, found no high"),
        ("scene,scale,low,high\nnowhere,1,,\n", r"a\.csv:2: scene: expected one of .*demo_room.*found 'nowhere'"),
    ],
)
def test_invalid_predictions_are_one_line(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    assert main(["--only-predictions", "--predictions", f"mine={tmp_path / 'a.csv'}"]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert error.count("\n") == 1


def _model(folder: Path, rename: Callable[[int], str]) -> list[tuple[str, NDArray[np.float64], NDArray[np.float64]]]:
    """Write a COLMAP model to `sparse`; return name, true rotation to the camera and true centre of its images.

    The set has another frame than the model, and 0.25 m per unit.
    """
    turn = Rotation.from_rotvec([0.3, -0.7, 0.2]).as_matrix()
    model = small_model("PINHOLE", [300.0, 300.0, 160.0, 120.0])
    (folder / "sparse").mkdir(parents=True)
    found = []
    for row, image in enumerate(sorted(model.images.values(), key=lambda one: one.name)):
        image.name = rename(row)
        pose = image.cam_from_world()
        centre = 0.25 * turn @ image.projection_center() + [3.0, 1.0, -2.0]
        found.append((image.name, pose.rotation.matrix() @ turn.T, centre))
    model.write_text(str(folder / "sparse"))
    return found


def write_eth3d(folder: Path) -> None:
    """The training data of eth3d.net/documentation: COLMAP text files whose frame is that of the laser scans."""
    rows = _model(folder, lambda row: f"DSC_{286 + row:04d}.JPG")
    target = folder / "dslr_calibration_undistorted"
    target.mkdir()
    (target / "cameras.txt").write_text("# Camera list\n0 PINHOLE 6200 4130 3410 3409 3100 2064\n")
    (target / "points3D.txt").write_text("1 0 0 1 9 9 9 0.5 1 0\n")
    lines = ["# Image list with two lines of data per image"]
    for number, (name, rotation, centre) in enumerate(rows):
        quaternion = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
        pose = " ".join(map(str, [*quaternion, *(-rotation @ centre)]))
        lines += [f"{number} {pose} 0 dslr_images_undistorted/{name}", "10.5 20.5 1" if number == 1 else ""]
    (target / "images.txt").write_text("\n".join(lines) + "\n")


def write_tum(folder: Path) -> None:
    """A groundtruth.txt at 100 Hz with a gap, in which the last image is."""
    rows = _model(folder, lambda row: f"rgb/{1305031102.175304 + row:.6f}.png")
    times = [float(Path(name).stem) for name, _, _ in rows]
    lines = ["# ground truth trajectory", "# timestamp tx ty tz qx qy qz qw"]
    for time, (_, rotation, centre) in list(zip(times, rows, strict=True))[:-1]:
        quaternion = Rotation.from_matrix(rotation.T).as_quat()
        lines += [" ".join(map(str, [f"{time + step:.4f}", *centre, *quaternion])) for step in (-0.005, 0.005)]
    lines.append(lines[-1].replace(lines[-1].split()[0], f"{times[-1] + 1:.4f}"))
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")


def write_seven_scenes(folder: Path) -> None:
    """Poses of frames, 4 x 4 from camera to world, next to the images."""
    for row, (_, rotation, centre) in enumerate(_model(folder, lambda row: f"frame-{row:06d}.color.png")):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation.T, centre
        text = "".join("\t ".join(f"{value:.7e}" for value in line) + "\t \n" for line in matrix)
        (folder / f"frame-{row:06d}.pose.txt").write_text(text)


WRITERS = {"courtyard": write_eth3d, "freiburg1_desk": write_tum, "chess/seq-01": write_seven_scenes}


@pytest.mark.parametrize("name", WRITERS)
def test_scale_of_public_sets(name: str, tmp_path: Path) -> None:
    WRITERS[name](tmp_path / name)
    folders = scene_folders([tmp_path])
    assert folders[name] == tmp_path / name
    assert true_scale(tmp_path / name) == pytest.approx(0.25, rel=1e-5)


def test_images_in_gaps_have_no_position(tmp_path: Path) -> None:
    write_tum(tmp_path)
    names = [view.name for view in read_scene(tmp_path / "sparse", "none").views]
    assert sorted(true_centres(tmp_path, names)) == sorted(names)[:-1]


@pytest.mark.parametrize("n_poses", [MIN_CAMERAS - 1, MIN_CAMERAS])
def test_too_few_true_positions(n_poses: int, tmp_path: Path) -> None:
    write_seven_scenes(tmp_path)
    for file in sorted(tmp_path.glob("*.pose.txt"))[n_poses:]:
        file.unlink()
    if n_poses < MIN_CAMERAS:
        with pytest.raises(InputError, match="poses: expected at least 4 images of the model"):
            true_scale(tmp_path)
    else:
        assert true_scale(tmp_path) == pytest.approx(0.25, rel=1e-5)


def test_a_damaged_pose_is_one_line(tmp_path: Path) -> None:
    write_seven_scenes(tmp_path)
    (tmp_path / "frame-000002.pose.txt").write_text("1 0 0 1\n0 1 0 x\n")
    with pytest.raises(InputError, match=r"frame-000002\.pose\.txt") as error:
        true_scale(tmp_path)
    assert "\n" not in str(error.value)
