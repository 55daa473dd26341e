"""Registry of open detectors (`data/detectors.toml`): names, addresses and checksums; downloads on request only.

A detector of the user is registered by a file `detector.toml` in the same form, with `file` (relative to it) instead of
`urls`, and with a list of names as `labels`.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, replace
from pathlib import Path

from metric_base.errors import InputError, Unquoted
from metric_base.folders import CACHE_VARIABLE, data_folder
from metric_base.progress import NoticeCallback, no_notice
from metric_base.records import toml_table

#: Name of the first detector of the registry, which is the recommended one.
AUTO = "auto"
#: Maximum time for the size of a file before its download, in seconds.
SIZE_TIMEOUT_S = 10.0

_SHA256 = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class RegisteredDetector:
    """An open detector, or one that a file of the user registers."""

    name: str
    title: str
    #: Addresses of the file, which are tried in this order.
    urls: tuple[str, ...]
    sha256: str
    licence: str
    #: Form of the graph: `torchvision`, `caffe`, or one of those that are recognised by their outputs (`one_stage`).
    input: str
    #: Name of a list of labels (`taxonomy.label_lists`), or names by label, label 0 being the background.
    labels: str | tuple[str, ...]
    #: Size of the file in bytes, if it is published.
    bytes: int | None = None
    #: The file of a detector of the user.
    file: Path | None = None

    @property
    def description(self) -> str:
        """Name, size if it is known, and licence."""
        size = "" if self.bytes is None else f", {self.bytes / 1e6:.0f} MB"
        return f"{self.name}{size}, {self.licence}"


def registry(file: Path | None = None) -> tuple[RegisteredDetector, ...]:
    """Read the registry.

    Raises
    ------
    InputError
        The file cannot be read, or an entry has no address or no sha256: a file that cannot be verified must not be
        run.
    """
    path = file or data_folder() / "detectors.toml"
    detectors = []
    for name, entry in toml_table(path, InputError).items():
        source = entry.get("urls") or entry.get("file") if isinstance(entry, dict) else None
        if not source or not _SHA256.fullmatch(str(entry.get("sha256", ""))):
            expected = "an address and a sha256 of 64 hexadecimal digits"
            raise InputError.at(path, name, expected, Unquoted(str(entry)))
        labels = entry.get("labels", "coco_91")
        detectors.append(
            RegisteredDetector(
                name,
                title=str(entry.get("title", "")),
                urls=tuple(entry.get("urls", ())),
                sha256=entry["sha256"],
                licence=str(entry.get("licence", "")),
                input=str(entry.get("input", "torchvision")),
                labels=labels if isinstance(labels, str) else ("", *map(str, labels)),
                bytes=entry.get("bytes"),
                file=None if entry.get("urls") else path.parent / str(source),
            )
        )
    return tuple(detectors)


def registry_entry(name: str) -> RegisteredDetector:
    """Return the detector with this name, the recommended one for `auto`, or that of a `.toml` file of the user.

    Raises
    ------
    InputError
        There is none, or the file of the user has another sha256.
    """
    if name.endswith(".toml"):
        entry = registry(Path(name))[0]
        if entry.file is not None and file_sha256(entry.file) != entry.sha256:
            raise InputError.at(entry.file, "sha256", f"{entry.sha256} (of {name})", Unquoted("another file"))
        return entry
    entries = registry()
    for entry in entries:
        if name in (entry.name, AUTO):
            return entry
    names = ", ".join(entry.description for entry in entries)
    expected = f"an ONNX file, auto, or a name of the registry: {names}"
    raise InputError.at(name, "--detector", expected, Unquoted("neither"))


def file_sha256(file: Path) -> str:
    """Return the sha256 of a file in hexadecimal digits; InputError if it cannot be read."""
    try:
        with file.open("rb") as body:
            return hashlib.file_digest(body, "sha256").hexdigest()
    except OSError as error:
        raise InputError.at(file, "file", "a readable file", Unquoted(error.strerror or "an error")) from None


def registry_entry_of(file: Path) -> RegisteredDetector | None:
    """Return the registered detector with the sha256 of this file, which the user may have downloaded."""
    sha256 = file_sha256(file)
    return next((entry for entry in registry() if entry.sha256 == sha256), None)


def download(entry: RegisteredDetector, notice: NoticeCallback = no_notice) -> Path:
    """Return the file of a detector in the cache; download it and verify its sha256 if it is missing.

    Parameters
    ----------
    entry : RegisteredDetector
    notice : callable
        Called before a download with a sentence about its size, licence, source and target.

    Raises
    ------
    InputError
        All downloads fail, or return another file.
    """
    try:
        import pooch
        import requests
    except ImportError:
        expected = "pooch for downloads (pip install 'metric-tree[detect]')"
        raise InputError.at(entry.name, "--detector", expected, Unquoted("not installed")) from None
    cache = pooch.create(pooch.os_cache("metric-tree") / "detectors", "", env=CACHE_VARIABLE).abspath
    pooch.get_logger().setLevel("WARNING")  # `notice` announces the download
    errors = []
    for url in entry.urls:
        try:
            if not (cache / f"{entry.name}.onnx").is_file():
                size = requests.head(url, allow_redirects=True, timeout=SIZE_TIMEOUT_S).headers.get("Content-Length")
                known = replace(entry, bytes=int(size)) if entry.bytes is None and size else entry
                notice(f"downloading {known.description}, from {url} to {cache}")
            return Path(pooch.retrieve(url, f"sha256:{entry.sha256}", f"{entry.name}.onnx", cache))
        except (OSError, ValueError) as error:  # no network (an OSError of requests), or another checksum
            errors.append((str(error).splitlines() or [type(error).__name__])[0])
    expected = f"a download of {' or '.join(entry.urls)} with sha256 {entry.sha256}"
    raise InputError.at(entry.name, "--detector", expected, Unquoted("; ".join(errors)))
