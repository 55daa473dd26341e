"""Download the files of a source from their public addresses into a cache, and verify their SHA-256."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from crawler.imports.declaration import Source, SourceFile
from metric_base.errors import InputError
from metric_base.files import write_whole

#: Environment variable with the folder of the cache.
CACHE_VARIABLE = "METRIC_TREE_CACHE"

#: Number of repeated attempts if a transfer fails or the content differs.
MAX_RETRIES = 1

#: Maximum size of a file in an archive in bytes.
MAX_MEMBER_BYTES = 1 << 30
#: Maximum number of files in an archive, and of their bytes; the members are read until one has the SHA-256.
MAX_MEMBERS, MAX_ARCHIVE_BYTES = 100_000, 1 << 33

#: Folder of downloads from which files are made; no pattern of a table matches this name.
_PUBLIC = ".public"


class NoInput(InputError):
    """The files of a source do not exist and cannot be downloaded."""


def download(source: Source) -> Path:
    """Download the files of a source into the cache of the user.

    Raises
    ------
    NoInput
        A file has no public address, cannot be downloaded, or has another SHA-256.
    """
    if source.downloads == "no":
        raise NoInput(f"{source.id}: expected --input: {source.fetch or 'its files'} (see {source.url})")
    import pooch
    import requests

    pooch.get_logger().setLevel("WARNING")  # otherwise an error has two lines
    store = pooch.create(
        path=pooch.os_cache("metric-tree") / "sources" / source.id,
        base_url="",
        env=CACHE_VARIABLE,
        registry={file.path: f"sha256:{file.sha256}" for file in source.files},
        urls={file.path: file.url for file in source.files},
        retry_if_failed=MAX_RETRIES,
    )
    for file in source.files:
        try:
            _fetch_file(file, store)
        except requests.ConnectionError:
            raise NoInput(f"{source.id}: expected a download of {file.url} or --input; found no connection") from None
        except (requests.RequestException, OSError, ValueError) as error:
            reason = str(error).splitlines()[0][:200]
            raise NoInput(f"{source.id}: expected a download of {file.url} or --input; found {reason}") from None
    return Path(store.abspath)


def _fetch_file(file: SourceFile, store: Any) -> None:
    """Download a file, or make it from the download at its address, unless the cache contains it.

    Raises
    ------
    ValueError
        The download is not an archive or JSON, or no file with the SHA-256 can be made from it. It is removed then.
    """
    import pooch

    if file.form == "same":
        store.fetch(file.path)
        return
    path = Path(store.abspath) / file.path
    if path.is_file() and _sha256(path.read_bytes()) == file.sha256:
        return
    # only the SHA-256 of the resulting file is known
    name, downloader = _sha256(file.url.encode()), pooch.HTTPDownloader()
    folder = Path(store.abspath) / _PUBLIC
    public = Path(pooch.retrieve(file.url, known_hash=None, fname=name, path=folder, downloader=downloader))
    try:
        content = next((data for data in _contents(file, public) if _sha256(data) == file.sha256), None)
    except (ValueError, zipfile.BadZipFile) as error:
        public.unlink()
        raise ValueError(f"no {file.form.partition('-')[0]}: {error}") from None
    if content is None:
        public.unlink()
        raise ValueError(f"nothing of which {file.path} with the sha256 {file.sha256[:12]}... can be made")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, content)


def _contents(file: SourceFile, public: Path) -> Iterator[bytes]:
    """Return the possible contents of a file: the members of an archive, or the JSON document in another format."""
    if file.form == "zip":
        with zipfile.ZipFile(public) as archive:
            members = archive.infolist()
            n_bytes = sum(info.file_size for info in members)
            if len(members) > MAX_MEMBERS or n_bytes > MAX_ARCHIVE_BYTES:
                limits = f"at most {MAX_MEMBERS:,} files of {MAX_ARCHIVE_BYTES:,} bytes in all"
                raise ValueError(f"expected {limits}; found {len(members):,} of {n_bytes:,}")
            infos = (info for info in members if not info.is_dir() and info.file_size <= MAX_MEMBER_BYTES)
            yield from (archive.read(info) for info in infos)
    else:
        yield json.dumps(json.loads(public.read_bytes()), indent=0 if file.form == "json-lines" else None).encode()


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
