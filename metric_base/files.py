"""Files and folders that appear whole or not at all, safe file names, locks, and protection against overwriting.

The system releases a lock when its process ends, also if it is killed. An existing file is replaced only with
`--overwrite`, and an input of the run is never replaced.
"""

from __future__ import annotations

import errno
import glob
import json
import os
import platform
import re
import shutil
import stat
import unicodedata
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from metric_base.errors import InputError
from metric_base.operating_system import is_alive, lock

#: Bytes at the beginning of a JSON file in which its schema is.
_SCHEMA_BYTES = 512
#: Suffixes of files that the readers of models, masks, measurements and releases open in an input folder.
INPUT_SUFFIXES = frozenset(
    {".bin", ".csv", ".db", ".json", ".jsonl", ".npy", ".npz", ".parquet", ".ply", ".toml", ".txt", ".vis"}
)
#: Folders of images, masks and depth maps; all their files are inputs.
_IMAGE_FOLDERS = frozenset({"images", "frames", "instances", "pictures", "masks", "depth"})
#: Number of folders above a model that are searched for its images.
_LEVELS_UP = 3
#: Errors of the system that mean that a place cannot be written; others are internal errors.
WRITE_ERRORS = frozenset({
    errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG, errno.EIO, errno.EACCES, errno.EPERM, errno.ENOENT,
    errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ENOTEMPTY, errno.ENAMETOOLONG, errno.ELOOP, errno.ENXIO,
    errno.ENODEV, errno.EPIPE, errno.EINVAL, errno.EBUSY, errno.ETXTBSY,
})  # fmt: skip
#: Names that Windows reserves for devices, with any suffix.
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³]|conin\$|conout\$)(\..*)?", re.IGNORECASE)
#: Characters that Windows does not allow in file names, and control characters, which a terminal would interpret.
_UNFIT = re.compile(r'[<>:"|?*\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]')
#: Maximum length of a file name in bytes, which leaves room for a temporary suffix.
MAX_NAME_BYTES = 200
#: Part of the names of temporary files that identifies the machine, for shared disks.
_MACHINE = f"{zlib.crc32(platform.node().encode()):08x}"


@contextmanager
def sole_holder(path: Path) -> Iterator[None]:
    """Lock a file, which is created if it does not exist, while the block runs.

    Raises
    ------
    BlockingIOError
        Another process has locked it.
    """
    while True:
        with path.open("a", encoding="ascii") as file:
            lock(file.fileno())
            # The last holder may have removed the file after it was opened here; others then lock a new one.
            try:
                is_current = os.path.samestat(os.fstat(file.fileno()), path.stat())
            except FileNotFoundError:
                is_current = False
            if is_current:
                yield
                return


@contextmanager
def sole_writer(out: Path) -> Iterator[None]:
    """Lock an output for this process while the block runs; the system releases the lock when the process ends.

    Raises
    ------
    InputError
        Another process is writing the same output.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    note = out.parent / f".{out.name}.lock"
    try:
        with sole_holder(note):
            try:
                yield
            finally:
                with suppress(PermissionError):  # Windows removes no open file
                    note.unlink(missing_ok=True)
    except BlockingIOError:
        advice = "wait until it ends, or choose another --out"
        raise InputError(f"{out}: another run is writing this output; {advice}") from None


#: Inputs of a run, and whether its outputs may replace existing files.
_RULES: ContextVar[tuple[tuple[Path, ...], bool]] = ContextVar("output_rules", default=((), False))


def set_rules(inputs: Iterable[Path], overwrite: bool) -> None:
    """Register the inputs and the `--overwrite` setting of a run in the current context (`contextvars`)."""
    _RULES.set((tuple(_with_companions(inputs)), overwrite))


def check_output(path: Path, option: str, schema: str | None = None) -> None:
    """Raise an error if writing a file would replace an input of the run, or an existing file without `--overwrite`.

    Parameters
    ----------
    path : Path
        File to write.
    option : str
        Option that names it.
    schema : str, optional
        Prefix of the `schema` of a JSON file that may be replaced without `--overwrite`, because the command continues
        it or owns its folder.

    Raises
    ------
    InputError
    """
    if Path(os.path.realpath(path)).is_symlink():
        raise InputError(f"{option}: expected a place that can be written, found a loop of symbolic links: {path}")
    if path.is_dir() or is_special(path) or not path.exists():
        return
    (inputs, overwrite), is_own = _RULES.get(), schema is not None and has_schema(path, schema)
    for source in inputs:
        if _is_read(path, source, is_own):
            raise InputError(f"{option}: {path} is read in this run ({source}); choose another name")
    if not is_own and not overwrite:
        raise InputError(f"{option}: {path} already exists; choose another name, or add --overwrite")


def check_folder(path: Path, option: str, suffix: str | None = None) -> None:
    """Raise an error if a folder exists.

    With `--overwrite`, a folder is accepted that contains only files with a suffix and no input of the run.

    Parameters
    ----------
    path : Path
        Folder to write.
    option : str
        Option that names it.
    suffix : str, optional
        Suffix of the files of a folder that may be replaced.

    Raises
    ------
    InputError
    """
    if not os.path.lexists(path):
        return
    inputs, overwrite = _RULES.get()
    if suffix is None or not path.is_dir() or path.is_symlink():
        raise InputError(f"{option}: expected a folder that is not there yet; found an existing one: {path}")
    if not overwrite:
        raise InputError(f"{option}: {path} already exists; choose another name, or add --overwrite")
    real = path.resolve()
    for source in inputs:
        is_image_folder = real.is_relative_to(source.resolve()) and real.name in _IMAGE_FOLDERS
        if is_image_folder or source.resolve().is_relative_to(real):
            raise InputError(f"{option}: {path} is read in this run ({source}); choose another name")
    for entry in path.rglob("*"):
        if entry.is_symlink() or not (entry.is_dir() or entry.suffix == suffix):
            raise InputError(f"{option}: expected a folder with only {suffix} files to replace; found {entry}")


def has_schema(path: Path, schema: str) -> bool:
    """Return True if the `schema` of a file begins with `schema`.

    It is at the beginning of a JSON file, which may be compressed, and in the metadata of a Parquet file.
    """
    try:
        if path.suffix == ".parquet":
            import pyarrow.parquet as pq  # not on the path of a query

            metadata = pq.read_metadata(path).metadata or {}
            return bool(metadata.get(b"schema", b"").startswith(schema.encode()))
        if path.suffix == ".gz":
            import gzip  # not on the path of a query

            with gzip.open(path) as packed:
                start = packed.read(_SCHEMA_BYTES)
        else:
            with path.open("rb") as content:
                start = content.read(_SCHEMA_BYTES)
    except (OSError, EOFError, ValueError, zlib.error):  # errors of Arrow are ValueError
        return False
    return f'"schema":"{schema}'.encode() in start.replace(b'": "', b'":"')


def is_special(path: Path) -> bool:
    """Return True if the path exists and is neither a file nor a folder: a device, a pipe, a socket."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _is_read(path: Path, source: Path, is_own: bool) -> bool:
    """Return True if `path` is the input `source`, or a file in the folder `source` that a reader may open."""
    if not source.exists():
        return False
    if path.samefile(source):
        return True
    real = path.resolve()
    if not source.is_dir() or not real.is_relative_to(source.resolve()):
        return False
    if real.parent.name in _IMAGE_FOLDERS:
        return True
    is_image_folder = not any(child.is_dir() for child in source.iterdir())  # it may be one: it has no subfolders
    return not is_own and (is_image_folder or real.suffix.lower() in INPUT_SUFFIXES)


def _with_companions(inputs: Iterable[Path]) -> Iterator[Path]:
    """Return the inputs and the files that they refer to: buffers, textures, the video of a work folder, images."""
    for path in inputs:
        yield path
        if path.suffix.lower() == ".gltf":
            yield from (path.parent / name for name in _texts_of(path, "uri"))
        if path.is_dir():
            for file in (path / "frames.json", path / "frame_poses.json"):
                yield from (Path(name) for name in _texts_of(file, "source"))
            above = [path.resolve(), *path.resolve().parents][: _LEVELS_UP + 1]
            yield from (place / "images" for place in above if (place / "images").is_dir())
        elif path.is_file() and path.suffix.lower() in (".bin", ".txt"):
            yield path.parent  # a file of a model represents its folder


def _texts_of(file: Path, key: str) -> list[str]:
    """Return the texts of a key anywhere in a JSON file."""
    texts: list[str] = []

    def collect(row: dict[str, object]) -> dict[str, object]:
        value = row.get(key)
        if isinstance(value, str) and not value.startswith("data:"):
            texts.append(value)
        return row

    try:
        json.loads(file.read_text(encoding="utf-8"), object_hook=collect)
    except (OSError, ValueError, RecursionError):
        return []  # its reader reports the error
    return texts


@contextmanager
def whole_file(path: Path, option: str | None = None, schema: str | None = None) -> Iterator[Path]:
    """Provide a temporary path that replaces `path` at the end of the block; after an error `path` is unchanged.

    The temporary file exists, and is empty. Its suffix differs, so that a file of a killed run is not read; the next
    run removes it. If `path` is a symbolic link, its target is replaced; devices and pipes are written directly.

    Raises
    ------
    InputError
        `option`, by which a user named the path, is given, and the system cannot write there (a full disk, no such
        folder, no permission), or `check_output` does not allow the replacement of an existing file.
    """
    if option is not None:
        check_output(path, option, schema)
    with _write_errors(path, option):
        if is_special(path):
            import tempfile  # not on the path of a query

            with tempfile.TemporaryDirectory() as folder:
                work = Path(folder) / path.name
                yield work
                with work.open("rb") as source, path.open("wb") as target:
                    shutil.copyfileobj(source, target)
            return
        target_path = Path(os.path.realpath(path)) if path.is_symlink() else path
        _remove_dead_parts(target_path)
        work = _new_part(target_path, is_folder=False)
        try:
            yield work
            work.replace(target_path)
        finally:
            with suppress(OSError):  # the first error is more informative
                work.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes, option: str | None = None, schema: str | None = None) -> None:
    """Write a file as `whole_file` does, completely or not at all; text is UTF-8."""
    with whole_file(path, option, schema) as work:
        work.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def whole_folder(path: Path, option: str | None = None, suffix: str | None = None) -> Iterator[Path]:
    """Provide a temporary folder that is renamed to `path` at the end of the block, and removed after an error.

    Temporary folders of killed runs for the same path are removed first. With `suffix`, an existing folder may be
    replaced as `check_folder` states.

    Raises
    ------
    InputError
        `path` exists already, or `option` is given and the system cannot write there.
    """
    check_folder(path, option or "folder", suffix)
    with _write_errors(path, option):
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_dead_parts(path)
        work = _new_part(path, is_folder=True)
        try:
            yield work
            work.chmod(0o755)  # other users had no access to the unfinished folder
            if os.path.lexists(path):
                old = _new_part(path, is_folder=True)
                path.rename(old / path.name)
                try:
                    work.rename(path)
                except OSError:
                    (old / path.name).rename(path)
                    raise
                finally:
                    shutil.rmtree(old, ignore_errors=True)
            else:
                work.rename(path)
        finally:
            shutil.rmtree(work, ignore_errors=True)  # it does not exist after a success


def inside(folder: Path, name: str) -> Path:
    """Return a path below `folder` for an untrusted name from a file.

    Drives, roots and steps upwards are dropped, so that `../a/b.png` becomes `folder/a/b.png`; characters that a
    system or a terminal does not accept become `_`; the device names of Windows (`con`, `nul.txt`) get a `_` in front;
    long parts are shortened. Two names can give one path: `OutputNames` keeps them apart.
    """
    parts = [part for part in re.split(r"[/\\]", name) if part.strip(" .")]
    safe = [_safe_part(part) for part in parts if not re.fullmatch(r"[A-Za-z]:", part)]
    return folder.joinpath(*(safe or ["_"]))


class OutputNames:
    """Distinct paths below a folder for names from files, on any system.

    Names that differ only in case or in the composition of an accent are one file on some systems; the later one
    gets a number.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._files: set[str] = set()
        self._folders: set[str] = set()

    def path(self, name: str) -> Path:
        """Return the path for a name; every call returns another path."""
        *folders, last = inside(Path(), name).parts
        place = self.folder
        for part in folders:
            place = self._free(place / part, self._files)
            self._folders.add(self._key(place))
        path = self._free(place / last, self._files, self._folders)
        self._files.add(self._key(path))
        return path

    def _free(self, wanted: Path, *taken: set[str]) -> Path:
        """Return the path, with the first number that distinguishes it from the existing ones if it is taken."""
        path, number = wanted, 1
        while any(self._key(path) in keys for keys in taken):
            number += 1
            path = wanted.with_name(f"{wanted.stem}-{number}{wanted.suffix}")
        return path

    @staticmethod
    def _key(path: Path) -> str:
        return unicodedata.normalize("NFC", str(path)).casefold()


def output_names(names: Iterable[str]) -> dict[str, Path]:
    """Return distinct relative paths for the names that a file states, see `OutputNames`."""
    free = OutputNames(Path())
    return {name: free.path(name) for name in dict.fromkeys(names)}


def output_file(path: Path, option: str = "--out") -> Path:
    """Check the path of a file that a command will write, before the work.

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
    """Return a part of a path that every system accepts."""
    text = _UNFIT.sub("_", part).rstrip(" .")
    text = f"_{text}" if _RESERVED.fullmatch(text) else text
    if len(text.encode()) <= MAX_NAME_BYTES:
        return text
    stem, dot, ending = text.rpartition(".")
    ending = f"{dot}{ending}" if stem and len(ending) <= 8 else ""
    return text.encode()[: MAX_NAME_BYTES - len(ending.encode())].decode(errors="ignore") + ending


@contextmanager
def _write_errors(path: Path, option: str | None) -> Iterator[None]:
    """Convert errors of the system in the block to InputError if an option names the path."""
    try:
        yield
    except OSError as error:
        if option is None or error.errno not in WRITE_ERRORS:
            raise
        words = error.strerror or "an error"
        raise InputError(f"{path}: {option}: expected a place that can be written, found {words}") from None


def _new_part(path: Path, *, is_folder: bool) -> Path:
    """Create an empty temporary file or folder next to `path`, under a random name that does not exist yet."""
    part = path.with_name(f".{path.name}.{_MACHINE}.{os.getpid()}.{os.urandom(8).hex()}.part")
    if is_folder:
        part.mkdir(mode=0o700)
    else:
        part.touch(exist_ok=False)
    return part


def _remove_dead_parts(path: Path) -> None:
    """Remove the temporary files and folders of `_new_part` whose process on this machine has ended."""
    name = re.compile(rf"\.{re.escape(path.name)}\.{_MACHINE}\.(\d+)\.[0-9a-f]{{16}}\.part(?:\.[a-z]+)?")
    with suppress(OSError):
        for entry in sorted(path.parent.glob(f".{glob.escape(path.name)}.*.part*")):
            match = name.fullmatch(entry.name)
            if match is None or is_alive(int(match[1])):
                continue
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.unlink(missing_ok=True)
