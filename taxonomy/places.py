"""Where the reviewed tables of the taxonomy lie: inside the package once installed, beside it in a checkout."""

from __future__ import annotations

from pathlib import Path

__all__ = ["taxonomy_directory"]


def taxonomy_directory() -> Path:
    """The folder of insertions, readings, decisions and frozen levels."""
    root = Path(__file__).resolve().parents[1]
    installed = root / "metric_tree" / "data" / "taxonomy"
    return installed if installed.is_dir() else root / "data" / "taxonomy"
