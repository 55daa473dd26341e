"""Files and folders that appear whole or not at all, and paths that never lead out of a folder."""

from __future__ import annotations

import errno
import glob
import os
import platform
import re
import shutil
import unicodedata
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from metric_base.errors import InputError
from metric_base.locks import hold
from metric_base.outputs import ANY_SCHEMA, check_output, is_special, stamp_file

__all__ = ["WRITE_ERRORS", "OutputNames", "inside", "output_file", "output_names", "whole_file", "whole_folder"]

#: What a system says about a place that cannot be written, as against an internal error.
WRITE_ERRORS = frozenset({
    errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG, errno.EIO, errno.EACCES, errno.EPERM, errno.ENOENT,
    errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ENOTEMPTY, errno.ENAMETOOLONG, errno.ELOOP, errno.ENXIO,
    errno.ENODEV, errno.EPIPE, errno.EINVAL, errno.EBUSY, errno.ETXTBSY,
})  # fmt: skip
#: Names that Windows keeps for devices, with any ending.
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³]|conin\$|conout\$)(\..*)?", re.IGNORECASE)
#: Characters that no Windows file name has, and controls that no terminal should be shown.
_UNFIT = re.compile(r'[<>:"|?*\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]')
#: Longest name of a file in bytes, less room for a temporary ending.
MAX_NAME_BYTES = 200


#: Tells machines that share a disk apart in the names of temporary files.
_MACHINE = f"{zlib.crc32(platform.node().encode()):08x}"


@contextmanager
def whole_file(path: Path, option: str | None = None, schema: str = ANY_SCHEMA) -> Iterator[Path]:
    """A temporary path to write to; `path` has its content when the block ends, and is untouched when it fails.

    The temporary name ends otherwise than the path's, so that what a kill leaves behind is not read as one of its
    kind; the next run removes it. A symbolic link stays and the file that it names is replaced; a device or a pipe is
    written to in place.

    Raises
    ------
    InputError
        Where `option` is given, by which a user named the path: the system cannot write there (a full disk, no such
        folder, no permission), or there is a file that `check_output` does not let go.
    """
    if option is not None:
        check_output(path, option, schema)
    with _write_errors(path, option):
        if is_special(path):
            import tempfile  # not of a query

            with tempfile.TemporaryDirectory() as folder:
                work = Path(folder) / path.name
                yield work
                with work.open("rb") as source, path.open("wb") as target:
                    shutil.copyfileobj(source, target)
            return
        target_path = path.resolve() if path.is_symlink() else path
        remove_dead_files(target_path)
        work = part_of(target_path)
        try:
            yield work
            if option is not None:
                stamp_file(work, path.suffix)
            work.replace(target_path)
        finally:
            with suppress(OSError):  # the error that led here says more
                work.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path, option: str | None = None) -> Iterator[Path]:
    """A temporary folder beside `path` that takes its name when the block ends, and is removed when it fails.

    What a killed run left of the same path is removed first.

    Raises
    ------
    InputError
        `path` exists already; where `option` is given also: the system cannot write there.
    """
    if os.path.lexists(path):
        raise InputError(
            f"{path}: {option or 'folder'}: expected a folder that is not there yet, found an existing one"
        )
    import tempfile

    with _write_errors(path, option):
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_dead_folders(path)
        work = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent))
        held = hold(work)
        try:
            yield work
            work.chmod(0o755)  # mkdtemp keeps others out
            work.rename(path)
        finally:
            shutil.rmtree(work, ignore_errors=True)  # gone already when all went well
            if held is not None:
                os.close(held)


def inside(folder: Path, name: str) -> Path:
    """A path below `folder` for a name that a file states, which is not to be trusted.

    Drives, roots and steps upwards are dropped, so that `../a/b.png` becomes `folder/a/b.png`; characters that a
    system or a terminal takes amiss become `_`; the device names of Windows (`con`, `nul.txt`) get a `_` in front;
    long parts are shortened. Two names can give one path: `OutputNames` keeps them apart.
    """
    parts = [part for part in re.split(r"[/\\]", name) if part.strip(" .")]
    safe = [_safe_part(part) for part in parts if not re.fullmatch(r"[A-Za-z]:", part)]
    return folder.joinpath(*(safe or ["_"]))


class OutputNames:
    """Paths below a folder for many names: none leads out, and no two are the same file on any system.

    Names that differ in case only, or in how an accent is composed, are one file on some systems; the later one
    gets a number.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._files: set[str] = set()
        self._folders: set[str] = set()

    def path(self, name: str) -> Path:
        """The path of a name's file, each one once."""
        *folders, last = inside(Path(), name).parts
        place = self.folder
        for part in folders:
            place = self._free(place / part, self._files)
            self._folders.add(self._key(place))
        path = self._free(place / last, self._files, self._folders)
        self._files.add(self._key(path))
        return path

    def _free(self, wanted: Path, *taken: set[str]) -> Path:
        """The path, or with the first number that makes it another than those taken."""
        path, number = wanted, 1
        while any(self._key(path) in keys for keys in taken):
            number += 1
            path = wanted.with_name(f"{wanted.stem}-{number}{wanted.suffix}")
        return path

    @staticmethod
    def _key(path: Path) -> str:
        return unicodedata.normalize("NFC", str(path)).casefold()


def output_names(names: Iterable[str]) -> dict[str, Path]:
    """Relative paths for names that a file states: each inside, no two the same file on any system."""
    free = OutputNames(Path())
    return {name: free.path(name) for name in dict.fromkeys(names)}


def output_file(path: Path, option: str = "--out") -> Path:
    """The path of a file that a command will write: asked before the work, so that none is done for nothing.

    Raises
    ------
    InputError
        The path is a folder, or the folder to write it in does not exist.
    """
    if path.is_dir():
        raise InputError(f"{option}: expected a file; found the folder {path}")
    if not path.parent.is_dir():
        raise InputError(f"{option}: expected a file in an existing folder; found no folder {path.parent}")
    return path


def _safe_part(part: str) -> str:
    """One part of a path, fit for every system."""
    text = _UNFIT.sub("_", part).rstrip(" .")
    text = f"_{text}" if _RESERVED.fullmatch(text) else text
    if len(text.encode()) <= MAX_NAME_BYTES:
        return text
    stem, dot, ending = text.rpartition(".")
    ending = f"{dot}{ending}" if stem and len(ending) <= 8 else ""
    room = MAX_NAME_BYTES - len(ending.encode())
    return text.encode()[:room].decode(errors="ignore") + ending


@contextmanager
def _write_errors(path: Path, option: str | None) -> Iterator[None]:
    """The system's refusals as errors of the input, where an option names the place."""
    try:
        yield
    except OSError as error:
        if option is None or error.errno not in WRITE_ERRORS:
            raise
        words = error.strerror or "an error"
        raise InputError(f"{path}: {option}: expected a place that can be written, found {words}") from None


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
