"""Registry of open detectors (`data/detectors.toml`): names, addresses and checksums; downloads on request only."""

from __future__ import annotations

import hashlib
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

from metric_base.errors import InputError, Unquoted
from metric_base.folders import data_folder

#: Environment variable with the folder of downloaded detectors (default: the cache of the user).
CACHE_VARIABLE = "METRIC_TREE_CACHE"

_FIELDS = ("title", "urls", "sha256", "licence", "input", "labels")

_SHA256 = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class RegisteredDetector:
    """An open detector."""

    name: str
    title: str
    #: Addresses of the file, which are tried in this order.
    urls: tuple[str, ...]
    sha256: str
    licence: str
    #: Form of the input of the graph: `torchvision` or `caffe`.
    input: str
    #: Name of a list of labels (`taxonomy.label_lists`).
    labels: str


def registry(file: Path | None = None) -> tuple[RegisteredDetector, ...]:
    """Read the registry.

    Raises
    ------
    InputError
        An entry has no address or no sha256: a file that cannot be verified must not be run.
    """
    path = file or data_folder() / "detectors.toml"
    entries = tomllib.loads(path.read_text(encoding="utf-8"))
    for name, entry in entries.items():
        if not entry.get("urls") or not _SHA256.fullmatch(entry.get("sha256", "")):
            expected = "an address and a sha256 of 64 hexadecimal digits"
            raise InputError.at(path, name, expected, Unquoted(f"{entry.get('urls')}, {entry.get('sha256')}"))
        entry["urls"] = tuple(entry["urls"])
    return tuple(RegisteredDetector(name, *(entry[field] for field in _FIELDS)) for name, entry in entries.items())


def registry_entry(name: str) -> RegisteredDetector:
    """Return the registered detector with this name; InputError if there is none."""
    for entry in registry():
        if entry.name == name:
            return entry
    sources = "--images DIR --detector model.onnx makes masks with your Mask R-CNN"
    if first := next(iter(registry()), None):
        sources += f", --detector {first.name} with an open one from {first.urls[0]} (sha256 {first.sha256})"
    raise InputError.at(name, "--detector", f"an ONNX file, or a name of the registry; {sources}", Unquoted("neither"))


def registry_entry_of(file: Path) -> RegisteredDetector | None:
    """Return the registered detector with the sha256 of this file, which the user may have downloaded."""
    with file.open("rb") as body:
        sha256 = hashlib.file_digest(body, "sha256").hexdigest()
    return next((entry for entry in registry() if entry.sha256 == sha256), None)


def download(entry: RegisteredDetector) -> Path:
    """Return the file of a detector in the cache; download it and verify its sha256 if it is missing.

    Raises
    ------
    InputError
        All downloads fail, or return another file.
    """
    try:
        import pooch
    except ImportError:
        expected = "pooch for downloads (pip install 'metric-tree[build]')"
        raise InputError.at(entry.name, "--detector", expected, Unquoted("not installed")) from None
    cache = pooch.create(pooch.os_cache("metric-tree") / "detectors", "", env=CACHE_VARIABLE).abspath
    errors = []
    for url in entry.urls:
        try:
            return Path(pooch.retrieve(url, f"sha256:{entry.sha256}", f"{entry.name}.onnx", cache))
        except (OSError, ValueError) as error:  # no network (an OSError of requests), or another checksum
            errors.append((str(error).splitlines() or [type(error).__name__])[0])
    expected = f"a download of {' or '.join(entry.urls)} with sha256 {entry.sha256}"
    raise InputError.at(entry.name, "--detector", expected, Unquoted("; ".join(errors)))
