"""Where releases are: shipped with the package, and in folders that the user names."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from metric_base.folders import data_folder
from metric_tree.release.release import MANIFEST, BadRelease
from metric_tree.release_download import REGISTRY_VARIABLE, cache_folder, fetch_release

__all__ = ["PATH_VARIABLE", "release_directory", "releases", "version_key"]

#: Folders that hold further releases, separated as in PATH.
PATH_VARIABLE = "METRIC_TREE_PATH"


def releases() -> list[Path]:
    """Folders of all available releases, newest version first; shipped ones before the user's of equal version."""
    return sorted(_release_folders(), key=lambda path: version_key(path.name), reverse=True)


def release_directory(ref: str | Path | None = None) -> Path:
    """The folder of a release: the newest one, the one of a version, or a path.

    Raises
    ------
    BadRelease
        No release has that version or path; the message lists the available ones.
    """
    available = releases()
    if ref is None:
        if not available:
            raise BadRelease(f"{data_folder() / 'release'}: expected a release; found none")
        return available[0]
    for directory in available:
        if directory.name == str(ref):
            return directory
    if Path(ref).is_dir():
        return Path(ref)
    if re.fullmatch(r"\d+\.\d+\.\d+[\w.-]*", str(ref)) and os.environ.get(REGISTRY_VARIABLE):
        return fetch_release(str(ref))
    names = ", ".join(path.name for path in available) or "none"
    raise BadRelease(f"{ref}: expected an available version ({names}) or a release's folder; found neither")


def version_key(version: str) -> tuple[int, ...]:
    """Sort key of a semantic version; a part that is not a number counts as older than any number."""
    return tuple(int(part) if part.isdigit() else -1 for part in version.split("."))


def _release_folders() -> Iterator[Path]:
    named = [Path(part) for part in os.environ.get(PATH_VARIABLE, "").split(os.pathsep) if part]
    for folder in (data_folder() / "release", *named, cache_folder()):
        if folder.is_dir():
            yield from (path for path in folder.iterdir() if (path / MANIFEST).is_file())
