"""Outputs that appear whole or not at all: written under a temporary name beside their place, then renamed."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from metric_base.faults import InputFault, Words
from metric_base.files import whole_file

__all__ = ["written_file", "written_folder"]


@contextmanager
def written_file(file: Path, option: str) -> Iterator[Path]:
    """A temporary path beside `file` that takes its name when the block ends without a fault.

    InputFault, which names the command's `option`, where the system refuses.
    """
    try:
        with whole_file(file) as temporary:
            yield temporary
    except OSError as fault:
        raise _refused(file, option, fault) from None


@contextmanager
def written_folder(folder: Path, option: str) -> Iterator[Path]:
    """A temporary folder beside `folder` that takes its name when the block ends without a fault.

    InputFault, which names the command's `option`, where the folder is there already or the system refuses.
    """
    if folder.exists():
        raise InputFault.at(folder, option, "a folder that is not there yet", Words("an existing one"))
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    except OSError as fault:
        raise _refused(folder, option, fault) from None
    try:
        yield temporary
        temporary.chmod(0o755)  # mkdtemp keeps others out
        temporary.rename(folder)
    except OSError as fault:
        raise _refused(folder, option, fault) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)  # gone already when all went well


def _refused(path: Path, option: str, fault: OSError) -> InputFault:
    return InputFault.at(path, option, "a place that can be written", Words(fault.strerror or "an error"))
