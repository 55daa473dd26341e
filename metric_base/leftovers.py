"""What a killed run left beside its output, and how the next run knows that nobody works on it any more."""

from __future__ import annotations

import glob
import os
import platform
import re
import shutil
import zlib
from contextlib import suppress
from pathlib import Path

from metric_base.locks import hold

__all__ = ["part_of", "remove_dead_files", "remove_dead_folders"]

#: Tells machines that share a disk apart in the names of temporary files.
_MACHINE = f"{zlib.crc32(platform.node().encode()):08x}"


def part_of(path: Path) -> Path:
    """The temporary file beside `path` that this process writes to."""
    return path.with_name(f".{path.name}.{_MACHINE}.{os.getpid()}.part")


def remove_dead_files(path: Path) -> None:
    """Remove the temporary files of a path whose process, on this machine, is gone."""
    name = re.compile(rf"\.{re.escape(path.name)}\.{_MACHINE}\.(\d+)\.part")
    with suppress(OSError):
        for entry in _parts(path):
            match = name.fullmatch(entry.name)
            if match is not None and not _is_alive(int(match[1])):
                entry.unlink(missing_ok=True)


def remove_dead_folders(path: Path) -> None:
    """Remove the temporary folders of a path that no process holds."""
    for entry in _parts(path):
        held = hold(entry) if entry.is_dir() and not entry.is_symlink() else None
        if held is not None:
            shutil.rmtree(entry, ignore_errors=True)
            os.close(held)


def _parts(path: Path) -> list[Path]:
    return sorted(path.parent.glob(f".{glob.escape(path.name)}.*.part"))


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True  # another user's
    return True
