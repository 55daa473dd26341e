"""Files at URLs of S3, Google Cloud Storage and Azure (fsspec): the place where a URL becomes a path.

`Path("s3://bucket/key")` is the path of a URL: its first part is the scheme. Workers of a build read raw items by
ranges of bytes (`opened`). Other inputs are copied to a temporary folder (`fetched`). Outputs are written to a local
folder and uploaded when the command ends (`staged`); a killed command continues there. Credentials come from where the
library of the store finds them (environment, files of its command line, role of the machine), never from a URL.
"""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from metric_base.errors import MAX_SHOWN, InputError, Unquoted
from metric_base.files import inside
from metric_base.folders import CACHE_VARIABLE

#: Library of each scheme, the extra of the same name.
LIBRARIES = {"s3": "s3fs", "gs": "gcsfs", "az": "adlfs"}
#: Half the bytes of a request: three requests for a block of a build, with 5 % that belongs to the next one.
REQUEST_BYTES = 2 << 20
#: File that makes a folder a release. It is uploaded last.
COMPLETION_MARK = "manifest.json"
#: Temporary folders with fetched inputs, by path and part of `fetched`.
_FETCHED: dict[tuple[Path, str], Path] = {}
#: URLs and local paths of the outputs of a command.
_STAGED: list[tuple[Path, Path]] = []


class StoreError(InputError):
    """A store cannot be used; a later run may continue the work of this one."""


def is_remote(path: Path) -> bool:
    """Return True if a path is that of a URL."""
    return len(path.parts) > 1 and path.parts[0].rstrip(":\\/") in LIBRARIES and path.parts[0][-1] == ":"


def url_of(path: Path) -> str:
    """Return the URL of a remote path, otherwise the path; for messages, too.

    >>> url_of(Path("s3://bucket/raw/a.jsonl")), url_of(Path("raw/a.jsonl"))
    ('s3://bucket/raw/a.jsonl', 'raw/a.jsonl')
    """
    return path.as_posix().replace(":/", "://", 1) if is_remote(path) else str(path)


def without_file_scheme(path: Path) -> Path:
    """Return the local path of a `file://` URL; other paths are returned unchanged.

    >>> without_file_scheme(Path("file:///data/my%20raw")).as_posix()
    '/data/my raw'
    """
    if len(path.parts) < 2 or path.parts[0] != "file:":
        return path
    from urllib.parse import unquote  # not on the path of a query

    return Path("/", *map(unquote, path.parts[1:]))


def remote_files(path: Path) -> list[Path]:
    """Return the files below a remote folder, sorted, or the file at the path.

    Raises
    ------
    InputError
        There is none, or the store cannot be read.
    """
    with _store(path) as (system, key):
        files = [Path(f"{path.parts[0]}//{name}") for name in sorted(system.find(key))]
    if not files:
        raise InputError(f"{url_of(path)}: expected an existing file or folder; found none")
    return files


def file_size(path: Path) -> int:
    """Return the size of a local or remote file in bytes."""
    if not is_remote(path):
        return path.stat().st_size
    with _store(path) as (system, key):
        return int(system.size(key))


def file_identity(path: Path) -> str:
    """Return names, sizes and versions (ETag) of the files at a remote path."""
    with _store(path) as (system, key):
        found = system.find(key, detail=True)
        return "".join(f"{name} {info.get('ETag') or system.ukey(name)}\n" for name, info in sorted(found.items()))


@contextmanager
def opened(path: Path) -> Iterator[io.BufferedIOBase]:
    """Open a local or remote file for reading; of a remote file only the bytes that are read are requested.

    Raises
    ------
    InputError
        The store cannot be read.
    """
    if is_remote(path):
        with (
            _store(path) as (system, key),
            system.open(key, "rb", block_size=REQUEST_BYTES, cache_type="readahead") as raw,
        ):
            yield io.BufferedReader(raw, REQUEST_BYTES)
    else:
        with path.open("rb") as file:
            yield file


def fetched(path: Path, part: str = "") -> Path:
    """Return the copy of a remote file or folder in a temporary folder; a local path is returned unchanged.

    Parameters
    ----------
    path : Path
        File or folder.
    part : str, optional
        Text that the paths of the files within a folder must contain.

    Raises
    ------
    InputError
        There is no such file, or the store cannot be read.
    """
    path = without_file_scheme(path)
    if not is_remote(path):
        return path
    if (path, part) in _FETCHED:
        return _FETCHED[path, part] / path.name
    import atexit
    from tempfile import mkdtemp

    files = [file for file in remote_files(path) if part in file.as_posix()[len(path.as_posix()) :]]
    atexit.register(_remove_fetched)
    _FETCHED[path, part] = Path(mkdtemp(prefix="metric-tree-"))
    target = _FETCHED[path, part] / path.name
    copies = [inside(target, file.relative_to(path).as_posix()) if file != path else target for file in files]
    for copy in copies:
        copy.parent.mkdir(parents=True, exist_ok=True)
    with _store(path) as (system, _):
        system.get([url_of(file) for file in files], [str(copy) for copy in copies])
    return target


def staged(path: Path, option: str, *, may_exist: bool) -> Path:
    """Return a local path for an output, which `with_remote_files` uploads; a local path is returned unchanged.

    The same URL has the same local path, so that a killed command continues.

    Raises
    ------
    InputError
        The output exists and may not, or the store cannot be reached.
    """
    path = without_file_scheme(path)
    if not is_remote(path):
        return path
    import hashlib

    with _store(path) as (system, key):
        if system.exists(key) and not may_exist:
            raise InputError(f"{option}: {url_of(path)} already exists; choose another name, or add --overwrite")
    cache = Path(os.environ.get(CACHE_VARIABLE) or Path.home() / ".cache" / "metric-tree")
    local = cache / "outputs" / hashlib.sha256(url_of(path).encode()).hexdigest()[:16] / path.name
    local.parent.mkdir(parents=True, exist_ok=True)
    _STAGED.append((path, local))
    return local


def with_remote_files(run: Callable[[], int]) -> int:
    """Return the status of a command after its outputs are uploaded; then its copies of inputs are removed.

    Files next to an output, such as the log of a build, are uploaded first, and `COMPLETION_MARK` last.

    Raises
    ------
    InputError
        The store cannot be written; the outputs are in the local folder that the message names.
    """
    _STAGED.clear()
    try:
        status = run()
        for path, local in _STAGED:
            if not local.exists():  # a part of a build, or no result
                continue
            files = [file for file in local.parent.rglob("*") if file.is_file() and not file.name.startswith(".")]
            files.sort(key=lambda file: (file.name == COMPLETION_MARK, file.is_relative_to(local), file))
            with _store(path, f"; the output is in {local.parent}") as (system, _):
                for file in files:
                    system.put_file(str(file), url_of(path.parent / file.relative_to(local.parent)))
            shutil.rmtree(local.parent)
        return status
    finally:
        _remove_fetched()


def _remove_fetched() -> None:
    """Remove the copies of inputs."""
    while _FETCHED:
        shutil.rmtree(_FETCHED.popitem()[1], ignore_errors=True)


@contextmanager
def _store(path: Path, advice: str = "") -> Iterator[tuple[Any, str]]:
    """Provide the file system of a URL and the key of the path; its errors are InputError or StoreError."""
    scheme, place = path.parts[0][:-1], path.parts[1]
    if "@" in place:  # the message must not contain them
        raise InputError(f"{scheme}://: expected a URL without credentials; they belong in the environment")
    from importlib.util import find_spec

    if find_spec(LIBRARIES[scheme]) is None:
        raise ModuleNotFoundError(f"No module named {LIBRARIES[scheme]!r}", name=LIBRARIES[scheme])
    from fsspec.core import url_to_fs

    url = url_of(path)
    try:
        yield url_to_fs(url, use_listings_cache=False)
    except (InputError, ModuleNotFoundError):
        raise
    except FileNotFoundError:
        raise InputError(f"{url}: expected an existing file or folder; found none{advice}") from None
    except Exception as error:  # noqa: BLE001 - each library has errors of its own
        found = Unquoted(f"{type(error).__name__}: {error}"[:MAX_SHOWN])
        raise StoreError(f"{url}: expected a store that can be used; found {found}{advice}") from None
