"""Pictures: where a scene's own images are."""

from __future__ import annotations

from pathlib import Path

from estimator.records.scene import Scene, View
from metric_base.errors import InputError, Unquoted
from metric_base.input_files import is_file

__all__ = ["image_file", "image_folders"]

#: Folders of pictures, by preference: COLMAP's and OpenSfM's, and that of a work folder of `estimate-scale`.
IMAGES = ("images", "frames")
#: How far above the model the images are looked for: `scene/dense/0/sparse` is the deepest usual place.
_LEVELS_UP = 3


def image_folders(scene: Scene, named: Path | None = None) -> tuple[Path, ...]:
    """The folder that the user named, then `images` and `frames` beside or above the model, nearest first.

    A folder may be a link; all are resolved, so that what lies in them is told from what a name leads out to.

    Raises
    ------
    InputError
        What the user named is no folder.
    """
    if named is not None and not named.is_dir():
        raise InputError.at(named, "--images", "a folder", Unquoted("a file" if named.exists() else "nothing"))
    starts = [path.resolve() for path in (scene.path, scene.model_path) if path is not None]
    places = [
        place / name for start in starts for place in (start, *list(start.parents)[:_LEVELS_UP]) for name in IMAGES
    ]
    first = [] if named is None else [named.resolve()]
    return tuple(dict.fromkeys([*first, *(place.resolve() for place in places if place.is_dir())]))


def image_file(folders: tuple[Path, ...], view: View) -> Path | None:
    """The view's picture in the first folder that has it, or None; a name never leads out of the folder."""
    for folder in folders:
        file = folder / view.name
        if is_file(file) and file.resolve().is_relative_to(folder):
            return file
    return None
