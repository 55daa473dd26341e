"""Where the files that the project ships are: inside the package once installed, beside it in a checkout."""

from __future__ import annotations

from pathlib import Path

__all__ = ["code_folder", "data_folder", "taxonomy_directory"]


def code_folder() -> Path:
    """The folder that holds the packages: the checkout, or `site-packages`."""
    return Path(__file__).resolve().parents[1]


def data_folder() -> Path:
    """The data that the project ships: `metric_tree/data` once installed, `data` in a checkout."""
    installed = code_folder() / "metric_tree" / "data"
    return installed if installed.is_dir() else code_folder() / "data"


def taxonomy_directory() -> Path:
    """The folder of insertions, source readings, decisions and frozen levels."""
    return data_folder() / "taxonomy"
