"""Available releases: shipped with the package, in folders of the user, or downloaded from a registry.

A registry is a JSON file, `metric-tree/registry/1`, with the SHA-256 of the files of each release:

    {"schema": "metric-tree/registry/1", "releases": {"2.0.0": {"manifest.json": "<sha256>", "nodes.parquet": ...}}}

`METRIC_TREE_REGISTRY` is its path or address; the files are next to it, in `VERSION/`. A release is downloaded once,
verified, and available offline afterwards.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from pathlib import Path
from typing import Any

from metric_base.errors import InputError
from metric_base.folders import CACHE_VARIABLE, data_folder
from metric_tree.release.release import MANIFEST, BadRelease, open_release, sha256

#: Environment variables: path or address of the registry, and folders with further releases, separated as in PATH.
REGISTRY_VARIABLE, PATH_VARIABLE = "METRIC_TREE_REGISTRY", "METRIC_TREE_PATH"
SCHEMA = "metric-tree/registry/1"
#: Maximum number of seconds without a byte from a server.
TIMEOUT_S = 30.0
#: Bytes that are read at a time.
CHUNK_BYTES = 1 << 20
#: Maximum size of a registry: some thousand files for each of a hundred releases.
MAX_REGISTRY_BYTES = 50_000_000
#: A relative path inside the folder of a release, and the SHA-256 of its file.
_ENTRY = re.compile(r"(?:[A-Za-z0-9_-][A-Za-z0-9_.-]*/)*[A-Za-z0-9_-][A-Za-z0-9_.-]* [0-9a-f]{64}")


def cache_folder() -> Path:
    """Return the folder of downloaded releases, which `METRIC_TREE_CACHE` changes."""
    return Path(os.environ.get(CACHE_VARIABLE) or Path.home() / ".cache" / "metric-tree") / "releases"


def registry_of(address: str) -> dict[str, dict[str, str]]:
    """Read the files and their SHA-256 by version from the path or address of a registry.

    Raises
    ------
    InputError
        The file cannot be read or is not a registry.
    """
    try:
        with _byte_stream(address) as stream:
            record: Any = json.loads(stream.read(MAX_REGISTRY_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{address}: expected a registry of releases; found {error}") from None
    releases = record.get("releases") if isinstance(record, dict) and record.get("schema") == SCHEMA else None
    lists: list[Any] = list(releases.values()) if isinstance(releases, dict) else []
    have_manifests = all(isinstance(files, dict) and MANIFEST in files for files in lists)
    entries = [f"{name} {value}" for files in lists for name, value in files.items()] if have_manifests else [""]
    if not isinstance(releases, dict) or not all(map(_ENTRY.fullmatch, entries)):
        raise InputError(f"{address}: schema: expected {SCHEMA} with files and their sha256 by version; found another")
    return releases


def registry_entry(directory: Path) -> dict[str, str]:
    """Return the SHA-256 of the files of a release by name, with its images in the shared store."""
    from metric_tree.release.images import image_files  # not needed by queries

    present = {path.relative_to(directory).as_posix(): path for path in directory.rglob("*") if path.is_file()}
    files = present | image_files(open_release(directory))
    return {name: sha256(file) for name, file in sorted(files.items())}


def fetch_release(version: str, registry: str | None = None) -> Path:
    """Return the folder of a release, which is downloaded if it does not exist.

    A partial file is continued. A file with another SHA-256 is rejected, and downloaded again the next time.

    Raises
    ------
    InputError
        No registry is configured, it lacks the version, a file cannot be downloaded, or its SHA-256 differs.
    """
    folder = cache_folder() / version
    if (folder / MANIFEST).is_file():  # the last file of a download
        return folder
    address = registry or os.environ.get(REGISTRY_VARIABLE)
    if not address:
        expected = f"an available release, or a registry in {REGISTRY_VARIABLE}"
        raise InputError(f"{version}: expected {expected}; found neither")
    releases = registry_of(address)
    if version not in releases:
        raise InputError(f"{address}: expected one of {', '.join(releases) or 'no release'}; found {version!r}")
    import pooch

    pooch.get_logger().setLevel("WARNING")
    for name in sorted(releases[version], key=lambda name: (name == MANIFEST, name)):
        url = f"{address.rpartition('/')[0] or '.'}/{version}/{name}"
        target, checksum = folder / name, releases[version][name]
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            pooch.retrieve(url, f"sha256:{checksum}", target.name, target.parent, downloader=_continue_download)
        except OSError as error:
            raise InputError(f"{url}: expected the file; found {error}; the part so far is kept") from None
        except ValueError:
            raise InputError(f"{url}: sha256: expected {checksum}; found another file") from None
    return folder


def _continue_download(address: str, output: Any, _: object) -> None:
    """Download a file for pooch, from the end of a partial file if the server supports ranges."""
    target = Path(str(output))
    part = target.parent / "parts" / f"{hashlib.sha256(address.encode()).hexdigest()[:24]}.part"
    part.parent.mkdir(exist_ok=True)
    start = part.stat().st_size if part.is_file() else 0
    with _byte_stream(address, start) as stream:
        is_continued = getattr(stream, "status", None) == 206
        with part.open("ab" if is_continued else "wb") as file:
            while chunk := stream.read(CHUNK_BYTES):
                file.write(chunk)
    stated = stream.headers.get("Content-Length") if hasattr(stream, "headers") else None
    if stated is not None and part.stat().st_size < int(stated) + (start if is_continued else 0):
        raise OSError("the connection broke off")
    part.replace(target)
    if not any(part.parent.iterdir()):
        part.parent.rmdir()


def _byte_stream(address: str, start: int = 0) -> Any:
    """Open a file, or an http(s) address from the byte `start` on."""
    if not re.match(r"https?://", address):
        return Path(address).open("rb")
    headers = {"Range": f"bytes={start}-"} if start else {}
    from urllib.request import Request, urlopen  # ssl and email are not needed by queries of local releases

    return urlopen(Request(address, headers=headers), timeout=TIMEOUT_S)  # noqa: S310 - http and https alone


def releases() -> list[Path]:
    """Return the folders of all available releases, newest version first; shipped ones precede others."""
    named = [Path(part) for part in os.environ.get(PATH_VARIABLE, "").split(os.pathsep) if part]
    folders = (folder for folder in (data_folder() / "release", *named, cache_folder()) if folder.is_dir())
    available = (path for folder in folders for path in folder.iterdir() if (path / MANIFEST).is_file())
    return sorted(available, key=lambda path: version_key(path.name), reverse=True)


def release_directory(ref: str | Path | None = None, licence: str | None = None) -> Path:
    """Return the folder of a release: of the newest one, of a version, or a given folder.

    Parameters
    ----------
    ref : str or Path, optional
        Version, folder, or URL of a folder (`s3://`, `gs://`, `az://`), which is copied.
    licence : str, optional
        `open` for the release that is fitted to sources with open licences alone: `VERSION-open`.

    Raises
    ------
    BadRelease
        No release has this version or path; the message lists the available versions.
    InputError
        `licence` is neither None nor `open`, or `ref` is a folder.
    """
    available = releases()
    if licence is not None:
        if licence != "open" or (ref is not None and Path(ref).is_dir()):
            raise InputError(f"licence: expected 'open', without a folder; found {licence!r}")
        version = str(ref) if ref is not None else next((path.name for path in available), "")
        ref = version if version.endswith("-open") else f"{version}-open"
    if ref is None:
        if not available:
            raise BadRelease(f"{data_folder() / 'release'}: expected a release; found none")
        return available[0]
    for directory in available:
        if directory.name == str(ref):
            return directory
    from metric_base.remote import fetched  # not needed by queries of an available version

    if (folder := fetched(Path(ref))).is_dir():
        return folder
    if re.fullmatch(r"\d+\.\d+\.\d+[\w.-]*", str(ref)) and os.environ.get(REGISTRY_VARIABLE):
        return fetch_release(str(ref))
    names = ", ".join(path.name for path in available) or "none"
    raise BadRelease(f"{ref}: expected an available version ({names}) or a release's folder; found neither")


def version_key(version: str) -> tuple[int, ...]:
    """Return the sort key of a semantic version; a part that is not a number is older than any number."""
    return tuple(int(part) if part.isdigit() else -1 for part in version.split("."))
