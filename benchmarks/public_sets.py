"""Read the true scale of reconstructions of public sets that a user has downloaded: ETH3D, TUM RGB-D, 7-Scenes.

A folder of such a set with a COLMAP model of its images in `sparse` is a scene. Its true scale is that of the
similarity from the camera centres of the model to those of the set, in metres:

- ETH3D (eth3d.net/documentation): `dslr_calibration_undistorted/images.txt` and others, COLMAP text models that were
  aligned to laser scans.
- TUM RGB-D (cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats): `groundtruth.txt`, lines
  `timestamp tx ty tz qx qy qz qw` with the optical centre of the colour camera; images have their times as names.
- 7-Scenes (microsoft.com/en-us/research/project/rgb-d-dataset-7-scenes): `frame-000000.pose.txt` next to
  `frame-000000.color.png`, a 4 x 4 matrix from camera to world in metres.

The readers were written after these pages and tested on files made after them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from estimator.evidence.alignment import align
from estimator.reconstructions.colmap import read_colmap
from estimator.reconstructions.scene_reader import read_scene
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, expect, in_file
from metric_base.input_files import read_text
from metric_base.parsing import finite_numbers

#: Folders of the calibrated cameras of ETH3D.
ETH3D = ("dslr_calibration_undistorted", "dslr_calibration_jpg", "rig_calibration_undistorted", "rig_calibration")
TUM = "groundtruth.txt"
SEVEN_SCENES = ".pose.txt"
#: Minimum number of images with a true position; three determine a similarity exactly.
MIN_CAMERAS = 4
#: Maximum time in seconds between readings of the motion capture system (100 Hz) around an image.
MAX_GAP_S = 0.1


def is_public_scene(folder: Path) -> bool:
    """Return whether a folder contains true positions of cameras, and a model in `sparse`."""
    if not (folder / "sparse").is_dir():
        return False
    has_poses = (folder / TUM).is_file() or any((folder / name / "images.txt").is_file() for name in ETH3D)
    return has_poses or next(folder.rglob(f"*{SEVEN_SCENES}"), None) is not None


def public_scale(folder: Path) -> float:
    """Return the metres per unit of the model in `sparse` of a public scene.

    Raises
    ------
    InputError
        A file is damaged, or fewer than `MIN_CAMERAS` images of the model have a true position.
    """
    scene = read_scene(folder / "sparse", "none")
    truth = true_centres(folder, [view.name for view in scene.views])
    pairs = [(view.centre, truth[view.name]) for view in scene.views if view.name in truth]
    alignment = align(*np.array(pairs).transpose(1, 0, 2)) if len(pairs) >= MIN_CAMERAS else None
    if alignment is None:
        expected = f"at least {MIN_CAMERAS} images of the model with a position in the set, which are not one point"
        raise InputError.at(folder, "poses", expected, len(pairs))
    return alignment.scale


def true_centres(folder: Path, names: Sequence[str]) -> dict[str, FloatArray]:
    """Return the camera centres (3,) in metres of the images with a known position."""
    for name in ETH3D:
        if (folder / name / "images.txt").is_file():
            known = {Path(view.name).name: view.centre for view in read_colmap(folder / name).views}
            return {image: known[Path(image).name] for image in names if Path(image).name in known}
    if (folder / TUM).is_file():
        return _interpolated(folder / TUM, names)
    centres = {}
    for image in names:
        stem = Path(image).name.split(".")[0]
        files = (place / f"{stem}{SEVEN_SCENES}" for place in (folder / Path(image).parent, folder))
        for file in [one for one in files if one.is_file()][:1]:
            with in_file(file):
                matrix = _rows(read_text(file), 4)
                expect(matrix.shape == (4, 4), "pose", "a 4 x 4 matrix", matrix.shape)
                centres[image] = matrix[:3, 3]
    return centres


def _interpolated(file: Path, names: Sequence[str]) -> dict[str, FloatArray]:
    """Return the positions of a trajectory of TUM at the times in the names of images, except in its gaps."""
    with in_file(file):
        rows = _rows(read_text(file), 8)
        expect(len(rows) > 1, "lines", "at least two poses", len(rows))
    centres = {}
    for image in names:
        if (match := re.fullmatch(r"\d+(\.\d+)?", Path(image).stem)) is None:
            continue
        time = float(match.group())
        after = int(np.searchsorted(rows[:, 0], time).clip(1, len(rows) - 1))
        if rows[after - 1, 0] <= time <= rows[after, 0] <= rows[after - 1, 0] + MAX_GAP_S:
            centres[image] = np.array([np.interp(time, rows[:, 0], rows[:, column]) for column in (1, 2, 3)])
    return centres


def _rows(text: str, n_columns: int) -> FloatArray:
    """Return the numbers (n, n_columns) of a text file, without comments."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    rows = [finite_numbers(line.split(), f"{n_columns} numbers") for line in lines]
    wrong = next((line for line, row in zip(lines, rows, strict=True) if len(row) != n_columns), None)
    expect(wrong is None, "line", f"{n_columns} numbers", wrong)
    return np.array(rows).reshape(-1, n_columns)
