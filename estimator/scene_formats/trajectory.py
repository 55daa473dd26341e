"""Read a trajectory of SLAM in the format of TUM with a cloud of the same name (MASt3R-SLAM, VGGT-SLAM).

Each line of `NAME.txt` is `time x y z qx qy qz qw`: the pose of a camera in the world, with the axes right, down,
forward. The images of the lines are those whose names contain the time, or the number of a frame: in
`keyframes/NAME` (MASt3R-SLAM, at the size of its network), or next to the file or in `images`. The cloud is `NAME.ply`.
The lens is not stated.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.reconstructions.ply import read_dense_cloud
from estimator.records.scene import Scene
from estimator.scene_formats.common import IMAGE_FOLDERS, pinhole_camera, posed_view
from metric_base.errors import FieldError, Unquoted, at_field, expect, in_file
from metric_base.images import IMAGE_SUFFIXES, image_header
from metric_base.input_files import folder_entries, is_file, read_text
from metric_base.parsing import matrix_of

#: Numbers of a line.
N_NUMBERS = 8


def is_trajectory(head: str) -> bool:
    """Return whether the first line that is no comment has `N_NUMBERS` numbers."""
    words = next((line for line in head.splitlines() if line.strip() and not line.startswith("#")), "").split()
    return len(words) == N_NUMBERS and all(re.fullmatch(r"[-+.\deE]+", word) for word in words)


def read_trajectory(file: Path, focal_px: float | None = None) -> Scene:
    """Read a trajectory and its cloud.

    Parameters
    ----------
    file : Path
    focal_px : float, optional
        Focal length in pixels of the images; by default that of their EXIF.

    Raises
    ------
    InputError
        A file is damaged, or the cloud, an image or the focal length is missing.
    """
    folders = [file.parent / "keyframes" / file.stem, *(file.parent / name for name in IMAGE_FOLDERS[:2])]
    entries = [entry for folder in folders if folder.is_dir() for entry in folder_entries(folder)]
    named = [entry for entry in entries[::-1] if entry.suffix.lower() in IMAGE_SUFFIXES]
    images = {float(time.group()): entry for entry in named if (time := re.search(r"\d+(\.\d+)?", entry.stem))}
    views = []
    with in_file(file):
        lines = [line for line in read_text(file).splitlines() if line.strip() and not line.startswith("#")]
        for row, line in enumerate(lines):
            with at_field(f"pose {row}"):
                time, *pose = matrix_of(line.split(), (N_NUMBERS,), "numbers").tolist()
                image = images.get(time)
                header = None if image is None else image_header(image)
                if image is None or header is None:
                    raise FieldError(
                        "image", f"one with {time:g} in its name, in keyframes/{file.stem}", Unquoted("none")
                    )
                focal = focal_px or header.focal_px
                if focal is None:
                    raise FieldError("focal length", "--focal PX, at the size of the images, or EXIF", Unquoted("none"))
                expect(any(pose[3:]), "quaternion", "not all zero", pose[3:])
                size = (header.width, header.height)
                lens = pinhole_camera(size, (focal, focal), (size[0] / 2, size[1] / 2), {})
                views.append(
                    posed_view(image.name, lens, Rotation.from_quat(pose[3:]).as_matrix().T, np.array(pose[:3]))
                )
        cloud = file.with_suffix(".ply")
        expect(is_file(cloud), "cloud", f"{cloud.name} next to it", Unquoted("none"))
    dense, warnings = read_dense_cloud(cloud, len(views))
    return Scene(file.parent, "network", tuple(views), np.empty((0, 3)), dense, warnings, file.parent)
