"""The registry of open detectors (`data/detectors.toml`): names, addresses, checksums; downloaded only on request."""

from __future__ import annotations

import hashlib
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

from metric_base.errors import InputError, Unquoted
from metric_base.folders import data_folder

#: Moves the folder in which downloaded detectors are kept (default: the user's cache).
CACHE_VARIABLE = "METRIC_TREE_CACHE"

_FIELDS = ("title", "urls", "sha256", "licence", "input", "labels")

_SHA256 = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class RegisteredDetector:
    """A detector that anybody may use: where its file lies (addresses are tried in turn), and the file's sha256."""

    name: str
    title: str
    urls: tuple[str, ...]
    sha256: str
    licence: str
    input: str
    labels: str


def registry(file: Path | None = None) -> tuple[RegisteredDetector, ...]:
    """The detectors of the registry file.

    Raises
    ------
    InputError
        An entry lacks an address or a sha256: a file that nobody can check is none to run.
    """
    path = file or data_folder() / "detectors.toml"
    entries = tomllib.loads(path.read_text(encoding="utf-8"))
    for name, entry in entries.items():
        if not entry.get("urls") or not _SHA256.fullmatch(entry.get("sha256", "")):
            expected = "an address and a sha256 of 64 hexadecimal digits"
            raise InputError.at(path, name, expected, Unquoted(f"{entry.get('urls')}, {entry.get('sha256')}"))
    rows = ({**entry, "urls": tuple(entry["urls"])} for entry in entries.values())
    return tuple(
        RegisteredDetector(name, *(row[field] for field in _FIELDS)) for name, row in zip(entries, rows, strict=True)
    )


def registry_entry(name: str) -> RegisteredDetector:
    """The detector of a name; InputError where there is no such name."""
    for entry in registry():
        if entry.name == name:
            return entry
    raise InputError.at(
        name, "--detector", f"an ONNX file, or a name of the registry; {how_to_get_one()}", Unquoted("neither")
    )


def registry_entry_of(file: Path) -> RegisteredDetector | None:
    """The entry whose file this is, by its sha256: somebody may have fetched it by hand."""
    with file.open("rb") as body:
        sha256 = hashlib.file_digest(body, "sha256").hexdigest()
    return next((entry for entry in registry() if entry.sha256 == sha256), None)


def download(entry: RegisteredDetector) -> Path:
    """The detector's file in the cache, fetched and checked against its sha256 where it is not there yet.

    Raises
    ------
    InputError
        No address gives it, or what comes is another file.
    """
    try:
        import pooch
    except ImportError:
        expected = "pooch for downloads (pip install 'metric-tree[build]')"
        raise InputError.at(entry.name, "--detector", expected, Unquoted("not installed")) from None
    kept = pooch.create(pooch.os_cache("metric-tree") / "detectors", "", env=CACHE_VARIABLE).abspath
    errors = []
    for url in entry.urls:
        try:
            return Path(pooch.retrieve(url, f"sha256:{entry.sha256}", f"{entry.name}.onnx", kept))
        except (OSError, ValueError) as error:  # no network (requests' errors are OSErrors), or another checksum
            errors.append((str(error).splitlines() or [type(error).__name__])[0])
    expected = f"a download of {' or '.join(entry.urls)} with sha256 {entry.sha256}"
    raise InputError.at(entry.name, "--detector", expected, Unquoted("; ".join(errors)))


def how_to_get_one() -> str:
    """One sentence on where a detector comes from, for those who have none."""
    own = "--images DIR --detector model.onnx makes them with a Mask R-CNN of your own"
    first = next(iter(registry()), None)
    if first is None:
        return own
    return f"{own}, --detector {first.name} with an open one from {first.urls[0]} (sha256 {first.sha256})"
