"""The files of a source from their public addresses: downloaded, checked against their sha256, kept in a cache."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from crawler.imports.declaration import Source, SourceFile
from metric_base.errors import InputError
from metric_base.files import whole_file

#: Moves the cache of downloaded sources.
CACHE_VARIABLE = "METRIC_TREE_CACHE"

#: Attempts after the first where a transfer fails or brings other bytes: one, for a line that stutters.
MAX_RETRIES = 1

#: Largest file of an archive that is unpacked.
MAX_MEMBER = 1 << 30

#: Folder of what was downloaded to make files of; a name that no pattern of a table finds.
_PUBLIC = ".public"


class NoInput(InputError):
    """The files of a source are neither here nor available for download."""


def download(source: Source) -> Path:
    """The source's files from their public addresses, checked against their sha256, in the user's cache.

    Raises
    ------
    NoInput
        A file has no public address, or no network answers, or what came is another file.
    """
    if source.downloads == "no":
        raise NoInput(f"{source.id}: expected --input: {source.fetch or 'its files'} (see {source.url})")
    import pooch
    import requests

    pooch.get_logger().setLevel("WARNING")  # an error is one line, not two
    store = _store(source)
    for file in source.files:
        try:
            _keep(file, store)
        except requests.ConnectionError:
            raise NoInput(f"{source.id}: expected a download of {file.url} or --input; found no connection") from None
        except (requests.RequestException, OSError, ValueError) as error:
            reason = str(error).splitlines()[0][:200]
            raise NoInput(f"{source.id}: expected a download of {file.url} or --input; found {reason}") from None
    return Path(store.abspath)


def _store(source: Source) -> Any:
    """The cache of one source, as a registry of names, sha256 and addresses."""
    import pooch

    return pooch.create(
        path=pooch.os_cache("metric-tree") / "sources" / source.id,
        base_url="",
        env=CACHE_VARIABLE,
        registry={file.path: f"sha256:{file.sha256}" for file in source.files},
        urls={file.path: file.url for file in source.files},
        retry_if_failed=MAX_RETRIES,
    )


def _keep(file: SourceFile, store: Any) -> None:
    """Put the file into the cache, with the right sha256, unless it is there already."""
    if file.form == "same":
        store.fetch(file.path)
        return
    path = Path(store.abspath) / file.path
    if path.is_file() and _sha256(path.read_bytes()) == file.sha256:
        return
    _make(file, path, _public(file, store))


def _public(file: SourceFile, store: Any) -> Path:
    """The file at the address, under a name of its own: only the file that is made of it has a known sha256."""
    import pooch

    folder = Path(store.abspath) / _PUBLIC
    downloader = pooch.HTTPDownloader()
    name = _sha256(file.url.encode())
    path: str = pooch.retrieve(file.url, known_hash=None, fname=name, path=folder, downloader=downloader)
    return Path(path)


def _make(file: SourceFile, path: Path, public: Path) -> None:
    """Write the file that has the sha256; what it cannot be made of is thrown away, to be downloaded anew."""
    try:
        made = next((data for data in _candidates(file, public) if _sha256(data) == file.sha256), None)
    except (ValueError, zipfile.BadZipFile) as error:
        public.unlink()
        raise ValueError(f"no {file.form.partition('-')[0]}: {error}") from None
    if made is None:
        public.unlink()
        raise ValueError(f"nothing of which {file.path} with the sha256 {file.sha256[:12]}... can be made")
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as work:
        work.write_bytes(made)


def _candidates(file: SourceFile, public: Path) -> Iterator[bytes]:
    """What can be the file: every member of an archive, the JSON document written anew."""
    if file.form == "zip":
        with zipfile.ZipFile(public) as archive:
            members = (one for one in archive.infolist() if not one.is_dir() and one.file_size <= MAX_MEMBER)
            yield from (archive.read(member) for member in members)
    else:
        indent = 0 if file.form == "json-lines" else None
        yield json.dumps(json.loads(public.read_bytes()), indent=indent).encode()


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
