"""Who may replace what: an existing file only if this program wrote it, and never an input of the run.

A JSON file of ours names its schema; into pictures, figures, pages, tables and videos a stamp is written that their
readers pass over. Everything else that exists belongs to somebody.
"""

from __future__ import annotations

import json
import os
import stat
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from metric_base.errors import InputError

__all__ = [
    "ANY_SCHEMA",
    "STAMP",
    "OutputRules",
    "check_output",
    "is_own_output",
    "is_special",
    "set_rules",
    "stamp_file",
]

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


_PNG = b"\x89PNG\r\n\x1a\n"
_COMMENT = b"<!-- " + STAMP + b" -->\n"
_JPEG = b"\xff\xfe" + struct.pack(">H", len(STAMP) + 2) + STAMP
_FREE = struct.pack(">I", len(STAMP) + 8) + b"free" + STAMP
_VOID = b"\xec" + bytes([0x80 | len(STAMP)]) + STAMP
_CHUNK = STAMP + b" " * (-len(STAMP) % 4)
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
_AT_END = frozenset({".svg", ".html", ".md", ".pdf", ".mp4", ".m4v", ".mov", ".mkv", ".webm"})


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
