"""Locations of shipped data: in the installed package, or in the checkout."""

from __future__ import annotations

import os
from pathlib import Path

#: Environment variable with the folder of files that can be made again; outputs are in `outputs` until their upload.
CACHE_VARIABLE = "METRIC_TREE_CACHE"


def code_folder() -> Path:
    """The folder that holds the packages: the checkout, or `site-packages`."""
    return Path(__file__).resolve().parents[1]


def data_folder() -> Path:
    """The data that the project ships: `metric_tree/data` once installed, `data` in a checkout."""
    installed = code_folder() / "metric_tree" / "data"
    return installed if installed.is_dir() else code_folder() / "data"


def user_data_folder() -> Path:
    """Return the folder of user data: `$XDG_DATA_HOME/metric-tree`, or `~/.local/share/metric-tree`."""
    home = os.environ.get("XDG_DATA_HOME")
    return (Path(home) if home else Path.home() / ".local" / "share") / "metric-tree"


def taxonomy_directory() -> Path:
    """The folder of insertions, source readings, decisions and frozen levels."""
    return data_folder() / "taxonomy"
