"""Releases by version from a registry of files with their sha256: fetched once, verified, offline afterwards.

The registry is a JSON file, `metric-tree/registry/1`:

    {"schema": "metric-tree/registry/1", "releases": {"2.0.0": {"manifest.json": "<sha256>", "nodes.parquet": ...}}}

`METRIC_TREE_REGISTRY` names it, by its path or its address; the files lie beside it, under `VERSION/`.

Where releases are: shipped with the package, and in folders that the user names.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from metric_base.errors import InputError
from metric_base.folders import data_folder
from metric_tree.release.release import MANIFEST, BadRelease, open_release, sha256

REGISTRY_VARIABLE, CACHE_VARIABLE = "METRIC_TREE_REGISTRY", "METRIC_TREE_CACHE"
SCHEMA = "metric-tree/registry/1"
#: Seconds without a byte after which a server is given up, and bytes read at a time.
TIMEOUT_S, PIECE = 30.0, 1 << 20
#: Bytes of a registry: some thousand files for each of a hundred releases.
MAX_REGISTRY = 50_000_000
_NAME = re.compile(r"(?:[A-Za-z0-9_-][A-Za-z0-9_.-]*/)*[A-Za-z0-9_-][A-Za-z0-9_.-]*")
#: Folders that hold further releases, separated as in PATH.
PATH_VARIABLE = "METRIC_TREE_PATH"


def cache_folder() -> Path:
    """Where fetched releases are kept; `METRIC_TREE_CACHE` moves it."""
    return Path(os.environ.get(CACHE_VARIABLE) or Path.home() / ".cache" / "metric-tree") / "releases"


def registry_of(address: str) -> dict[str, dict[str, str]]:
    """Files and their sha256 by version, from a registry's path or address.

    Raises
    ------
    InputError
        It cannot be read, or is no registry.
    """
    try:
        with _byte_stream(address) as stream:
            record: Any = json.loads(stream.read(MAX_REGISTRY))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{address}: expected a registry of releases; found {error}") from None
    releases = record.get("releases") if isinstance(record, dict) and record.get("schema") == SCHEMA else None
    if not isinstance(releases, dict) or not all(map(_is_release, releases.values())):
        raise InputError(f"{address}: schema: expected {SCHEMA} with files and their sha256 by version; found another")
    return releases


def fetch_release(version: str, registry: str | None = None) -> Path:
    """The folder of a release, fetched where it is not there yet.

    A file that came in part is continued; one whose sha256 is another is refused and fetched anew the next time.

    Raises
    ------
    InputError
        No registry is configured, it lacks the version, a file cannot be fetched, or one is not as the registry says.
    """
    folder = cache_folder() / version
    if (folder / "manifest.json").is_file():  # it comes last, so that the release is whole
        return folder
    address = registry or os.environ.get(REGISTRY_VARIABLE)
    if not address:
        raise InputError(
            f"{version}: expected an available release, or a registry in {REGISTRY_VARIABLE}; found neither"
        )
    releases = registry_of(address)
    if version not in releases:
        raise InputError(f"{address}: expected one of {', '.join(releases) or 'no release'}; found {version!r}")
    for name in sorted(releases[version], key=lambda name: (name == "manifest.json", name)):
        _fetch_file(f"{address.rpartition('/')[0] or '.'}/{version}/{name}", folder / name, releases[version][name])
    return folder


def _fetch_file(address: str, target: Path, checksum: str) -> None:
    """A file by pooch, which verifies it and puts it in its place whole."""
    import pooch

    pooch.get_logger().setLevel("WARNING")
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        pooch.retrieve(address, f"sha256:{checksum}", target.name, target.parent, downloader=_continue_download)
    except OSError as error:
        raise InputError(f"{address}: expected the file; found {error}; what came so far is kept") from None
    except ValueError:
        raise InputError(f"{address}: sha256: expected {checksum}; found another file") from None


def _continue_download(address: str, output: Any, _: object) -> None:
    """A downloader of pooch: goes on where an earlier one broke off, as far as the server lets it."""
    target = Path(str(output))
    part = target.parent / "parts" / f"{_short_name(address)}.part"
    part.parent.mkdir(exist_ok=True)
    start = part.stat().st_size if part.is_file() else 0
    with _byte_stream(address, start) as stream:
        goes_on = getattr(stream, "status", None) == 206
        with part.open("ab" if goes_on else "wb") as file:
            while piece := stream.read(PIECE):
                file.write(piece)
    stated = stream.headers.get("Content-Length") if hasattr(stream, "headers") else None
    if stated is not None and part.stat().st_size < int(stated) + (start if goes_on else 0):
        raise OSError("the connection broke off")
    part.replace(target)
    if not any(part.parent.iterdir()):
        part.parent.rmdir()


def _short_name(text: str) -> str:
    """A name for an address."""
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def _byte_stream(address: str, start: int = 0) -> Any:
    """A stream of a file, or of an http(s) address from a byte on."""
    if not re.match(r"https?://", address):
        return Path(address).open("rb")
    headers = {"Range": f"bytes={start}-"} if start else {}
    from urllib.request import Request, urlopen  # loads ssl and email, which a query of a release at hand needs not

    return urlopen(Request(address, headers=headers), timeout=TIMEOUT_S)  # noqa: S310 - http and https alone


def _is_release(files: Any) -> bool:
    """Return True if it is files with checksums, none of which leads out of its folder."""
    return (
        isinstance(files, dict)
        and "manifest.json" in files
        and all(
            _NAME.fullmatch(name) and isinstance(checksum, str) and re.fullmatch("[0-9a-f]{64}", checksum)
            for name, checksum in files.items()
        )
    )


def registry_entry(directory: Path) -> dict[str, str]:
    """The files of a release and their sha256, as a registry has them; images of the shared store among them."""
    from metric_tree.release.images import image_files  # with what a query does not need

    own = {path.relative_to(directory).as_posix(): path for path in directory.rglob("*") if path.is_file()}
    files = own | image_files(open_release(directory))
    return {name: sha256(file) for name, file in sorted(files.items())}


def releases() -> list[Path]:
    """Folders of all available releases, newest version first; shipped ones before the user's of equal version."""
    return sorted(_release_folders(), key=lambda path: version_key(path.name), reverse=True)


def release_directory(ref: str | Path | None = None) -> Path:
    """The folder of a release: the newest one, the one of a version, or a path.

    Raises
    ------
    BadRelease
        No release has that version or path; the message lists the available ones.
    """
    available = releases()
    if ref is None:
        if not available:
            raise BadRelease(f"{data_folder() / 'release'}: expected a release; found none")
        return available[0]
    for directory in available:
        if directory.name == str(ref):
            return directory
    if Path(ref).is_dir():
        return Path(ref)
    if re.fullmatch(r"\d+\.\d+\.\d+[\w.-]*", str(ref)) and os.environ.get(REGISTRY_VARIABLE):
        return fetch_release(str(ref))
    names = ", ".join(path.name for path in available) or "none"
    raise BadRelease(f"{ref}: expected an available version ({names}) or a release's folder; found neither")


def version_key(version: str) -> tuple[int, ...]:
    """Sort key of a semantic version; a part that is not a number counts as older than any number."""
    return tuple(int(part) if part.isdigit() else -1 for part in version.split("."))


def _release_folders() -> Iterator[Path]:
    named = [Path(part) for part in os.environ.get(PATH_VARIABLE, "").split(os.pathsep) if part]
    for folder in (data_folder() / "release", *named, cache_folder()):
        if folder.is_dir():
            yield from (path for path in folder.iterdir() if (path / MANIFEST).is_file())
