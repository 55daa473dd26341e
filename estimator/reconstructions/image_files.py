"""Find the images of a scene: in and above the folder of its model, or in a folder that the user names."""

from __future__ import annotations

from glob import escape
from pathlib import Path

from estimator.records.scene import Scene, View
from metric_base.errors import InputError, Unquoted
from metric_base.input_files import is_file

#: Names of image folders, the preferred one first: of COLMAP and OpenSfM, and of the work folder of `estimate-scale`.
IMAGE_FOLDERS = ("images", "frames")
#: Number of folders above a model in which images and masks are searched; `scene/dense/0/sparse` is the deepest usual
#: location of a model.
MAX_LEVELS_UP = 3


def folders_above(scene: Scene) -> tuple[Path, ...]:
    """Return the folders of the scene and of its model, each followed by `MAX_LEVELS_UP` folders above it."""
    starts = [path.resolve() for path in (scene.path, scene.model_path) if path is not None]
    return tuple(dict.fromkeys(folder for start in starts for folder in (start, *start.parents[:MAX_LEVELS_UP])))


def image_folders(scene: Scene, named: Path | None = None) -> tuple[Path, ...]:
    """Return the folders that may contain the images of a scene.

    Parameters
    ----------
    scene : Scene
    named : Path, optional
        Folder specified by the user.

    Returns
    -------
    tuple of Path
        The specified folder, then `images` and `frames` in or above the model, the nearest first, then the folder of
        the model, from which nerfstudio names its images. Links are resolved, so that files outside the folders can be
        detected.

    Raises
    ------
    InputError
        `named` is not a folder.
    """
    if named is not None and not named.is_dir():
        raise InputError.at(named, "--images", "a folder", Unquoted("a file" if named.exists() else "nothing"))
    candidates = [folder / name for folder in folders_above(scene) for name in IMAGE_FOLDERS]
    candidates += [
        path if path.is_dir() else path.parent for path in (scene.path, scene.model_path) if path is not None
    ]
    first = [] if named is None else [named.resolve()]
    return tuple(dict.fromkeys([*first, *(folder.resolve() for folder in candidates if folder.is_dir())]))


def image_file(folders: tuple[Path, ...], view: View) -> Path | None:
    """Return the image of a view in the first folder that contains it, or None; links out of the folder are ignored."""
    for folder in folders:
        # `cameras.json` of 3DGS names images without their suffixes.
        named = [] if Path(view.name).suffix else sorted(folder.glob(f"{escape(view.name)}.*"))
        for file in (folder / view.name, *named):
            if is_file(file) and file.resolve().is_relative_to(folder):
                return file
    return None
