"""Files and folders that appear whole or not at all, and paths that never lead out of a folder.

A file or folder that one process at a time holds; the system lets go of it when the process ends, killed too.

Who may replace what: an existing file only if this program wrote it, and never an input of the run.

A JSON file of ours names its schema; into pictures, figures, pages, tables and videos a stamp is written that their
readers pass over. Everything else that exists belongs to somebody.
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
import struct
import sys
import unicodedata
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from metric_base.errors import InputError

#: What our JSON files have as `schema`, whatever their kind.
ANY_SCHEMA = "metric-tree/"
STAMP = b"written by metric-tree"
#: Bytes at the beginning and at the end of a file among which a stamp is, and at the beginning a schema.
_ENDS, _SCHEMA_BYTES = 1 << 16, 512
_JSON = (".json", ".jsonl")
#: The first line of tables.
_TABLES = (b"node,name,divergence,samples,sources",)
#: Folders whose pictures are input, whoever wrote them.
_PICTURE_FOLDERS = frozenset({"images", "frames", "instances", "pictures", "masks", "depth"})
#: Folders above a model in which its pictures are looked for.
_LEVELS_UP = 3
_PNG = b"\x89PNG\r\n\x1a\n"
_COMMENT = b"<!-- " + STAMP + b" -->\n"
_JPEG = b"\xff\xfe" + struct.pack(">H", len(STAMP) + 2) + STAMP
_FREE = struct.pack(">I", len(STAMP) + 8) + b"free" + STAMP
_VOID = b"\xec" + bytes([0x80 | len(STAMP)]) + STAMP
_CHUNK = STAMP + b" " * (-len(STAMP) % 4)
_AT_END = frozenset({".svg", ".html", ".md", ".pdf", ".mp4", ".m4v", ".mov", ".mkv", ".webm"})
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
def sole_holder(path: Path) -> Iterator[None]:
    """Holds a file, which is made if it is not there, while the block runs.

    Raises
    ------
    BlockingIOError
        Another process holds it.
    """
    with path.open("a", encoding="ascii") as file:
        _lock(file.fileno())
        yield


def hold(folder: Path) -> int | None:
    """A descriptor that holds a folder until it is closed or the process ends; None if another process holds it."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:  # gone meanwhile; Windows opens no folder, and keeps its leftovers
        return None
    try:
        _lock(descriptor)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _lock(descriptor: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError(*error.args) from None
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


@dataclass(frozen=True, slots=True)
class OutputRules:
    """Of one run: the files and folders that it reads, and whether its outputs may replace files of others."""

    inputs: tuple[Path, ...] = ()
    overwrite: bool = False


_RULES: ContextVar[OutputRules] = ContextVar("output_rules")


_NO_RULES = OutputRules()


def set_rules(inputs: Iterable[Path], overwrite: bool) -> None:
    """State what a run reads, and what `--overwrite` says; it holds in this context (`contextvars`)."""
    _RULES.set(OutputRules(tuple(_with_companions(inputs)), overwrite))


def check_output(path: Path, option: str, schema: str | None = ANY_SCHEMA) -> None:
    """See that a file may be written: it is not there, or it is ours and not read in this run.

    schema : what the `schema` of a JSON file that may be replaced begins with; None where no JSON file may be.

    Raises
    ------
    InputError
        It is an input, or somebody else's, and `--overwrite` was not given.
    """
    if path.is_dir() or is_special(path) or not path.exists():
        return
    rules, own = _RULES.get(_NO_RULES), is_own_output(path, schema)
    for source in rules.inputs:
        if _is_read(path, source, own):
            raise InputError(f"{option}: {path} is read in this run ({source}); choose another name")
    if not own and not rules.overwrite:
        raise InputError(
            f"{option}: {path} already exists and is not an output of this program; choose another name, or --overwrite"
        )


def is_own_output(path: Path, schema: str | None = ANY_SCHEMA) -> bool:
    """Whether a file is one that this program writes: by its schema, its stamp or its first line; or it is empty."""
    try:
        head, tail = _ends(path)
    except (OSError, EOFError, zlib.error):
        return False
    if not head:
        return True  # nothing is lost
    names = "".join(path.suffixes[-2:]).lower()
    if any(suffix in names for suffix in _JSON):
        start = head[:_SCHEMA_BYTES].replace(b'": "', b'":"')
        return schema is not None and f'"schema":"{schema}'.encode() in start
    return STAMP in head or STAMP in tail or head.startswith(_TABLES)


def is_special(path: Path) -> bool:
    """Whether there is something at the path that is neither a file nor a folder: a device, a pipe, a socket."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def stamp_file(file: Path, suffix: str) -> None:
    """Write our stamp into a finished file where its readers pass over it; nothing where the form has no such place.

    suffix : of the name that the file will have.
    """
    form = _STAMPS.get(suffix.lower())
    if form is None or not file.is_file() or STAMP in b"".join(_ends(file)):
        return
    if suffix.lower() in _AT_END:
        with file.open("ab") as content:
            content.write(form)
        return
    data = file.read_bytes()
    if data[: len(_PNG)] == _PNG:
        place = len(_PNG) + 25  # behind IHDR, which is first and of fixed length
        file.write_bytes(data[:place] + form + data[place:])
    elif data[:2] == b"\xff\xd8":
        file.write_bytes(data[:2] + form + data[2:])
    elif data[:4] in (b"RIFF", b"glTF"):
        # both state their whole length: RIFF without its first eight bytes, glTF with them
        at, less = (4, 8) if data[:4] == b"RIFF" else (8, 0)
        data += form
        file.write_bytes(data[:at] + struct.pack("<I", len(data) - less) + data[at + 4 :])


def _chunk(kind: bytes, data: bytes) -> bytes:
    """A chunk of PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


#: The stamp in each form: a text chunk of PNG, a comment of JPEG, SVG, HTML, Markdown and PDF, a `free` box of MP4, a
#: `Void` element of Matroska, a chunk of a kind that readers of WebP and glTF do not know.
_STAMPS = {
    ".png": _chunk(b"tEXt", b"Software\x00" + STAMP),
    ".jpg": _JPEG,
    ".jpeg": _JPEG,
    ".webp": b"MTRE" + struct.pack("<I", len(_CHUNK)) + _CHUNK,
    ".glb": struct.pack("<I", len(_CHUNK)) + b"MTRE" + _CHUNK,
    ".svg": _COMMENT,
    ".html": _COMMENT,
    ".md": _COMMENT,
    ".pdf": b"% " + STAMP + b"\n",
    ".mp4": _FREE,
    ".m4v": _FREE,
    ".mov": _FREE,
    ".mkv": _VOID,
    ".webm": _VOID,
}


def _ends(path: Path) -> tuple[bytes, bytes]:
    """The first and the last bytes of a file; of a packed one the first that are in it."""
    if path.suffix == ".gz":
        import gzip  # not of a query

        with gzip.open(path) as packed:
            return packed.read(_ENDS), b""
    with path.open("rb") as content:
        head = content.read(_ENDS)
        content.seek(max(0, content.seek(0, os.SEEK_END) - _ENDS))
        return head, content.read()


def _is_read(path: Path, source: Path, own: bool) -> bool:
    """Whether a file is an input or part of a folder that is one, where results of ours may be written again."""
    if not source.exists():
        return False
    if path.samefile(source):
        return True
    real = path.resolve()
    if not source.is_dir() or not real.is_relative_to(source.resolve()):
        return False
    return not own or real.parent.name in _PICTURE_FOLDERS


def _with_companions(inputs: Iterable[Path]) -> Iterator[Path]:
    """The inputs and what they name: buffers and textures, the video of a work folder, pictures beside a model."""
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
            yield path.parent  # any file of a model stands for its folder


def _texts_of(file: Path, key: str) -> list[str]:
    """The texts of a key anywhere in a JSON file."""
    texts: list[str] = []

    def collect(row: dict[str, object]) -> dict[str, object]:
        value = row.get(key)
        if isinstance(value, str) and not value.startswith("data:"):
            texts.append(value)
        return row

    try:
        json.loads(file.read_text(encoding="utf-8"), object_hook=collect)
    except (OSError, ValueError, RecursionError):
        return []  # whoever reads it says what is wrong with it
    return texts


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
