"""Where releases are: shipped with the package, and in folders that the user names."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from metric_base.folders import data_folder
from metric_tree.release import MANIFEST, BadRelease

__all__ = ["PATH_VARIABLE", "release_directory", "releases", "version_key"]

#: Folders that hold further releases, separated as in PATH.
PATH_VARIABLE = "METRIC_TREE_PATH"


def releases() -> list[Path]:
    """Folders of all releases at hand, newest version first; shipped ones before the user's of equal version."""
    return sorted(_found(), key=lambda path: version_key(path.name), reverse=True)


def release_directory(ref: str | Path | None = None) -> Path:
    """The folder of a release: the newest one, or that of a version, or a path.

    Raises
    ------
    BadRelease
        Nothing at hand bears that version or path; the message lists what is.
    """
    found = releases()
    if ref is None:
        if not found:
            raise BadRelease(f"{data_folder() / 'release'}: expected a release; found none")
        return found[0]
    for directory in found:
        if directory.name == str(ref):
            return directory
    if Path(ref).is_dir():
        return Path(ref)
    at_hand = ", ".join(path.name for path in found) or "none"
    raise BadRelease(f"{ref}: expected a version at hand ({at_hand}) or a release's folder; found neither")


def version_key(version: str) -> tuple[int, ...]:
    """Sort key of a semantic version; what is no number counts as older than any."""
    return tuple(int(part) if part.isdigit() else -1 for part in version.split("."))


def _found() -> Iterator[Path]:
    named = [Path(part) for part in os.environ.get(PATH_VARIABLE, "").split(os.pathsep) if part]
    for folder in (data_folder() / "release", *named):
        if folder.is_dir():
            yield from (path for path in folder.iterdir() if (path / MANIFEST).is_file())
