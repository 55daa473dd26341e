"""The registry of open detectors (`data/detectors.toml`): names, addresses, checksums; downloaded only on request."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

from estimator.scene import BadScene, told
from metric_tree.releases import data_directory

__all__ = ["CACHE_VARIABLE", "RegisteredDetector", "downloaded", "how_to_get_one", "registered", "registry"]

#: Moves the folder in which downloaded detectors are kept (default: the user's cache).
CACHE_VARIABLE = "METRIC_TREE_CACHE"

_FIELDS = ("title", "url", "sha256", "licence", "input", "labels")


@dataclass(frozen=True, slots=True)
class RegisteredDetector:
    """A detector that anybody may use; `url` and `sha256` are empty until a maintainer has filled them in."""

    name: str
    title: str
    url: str
    sha256: str
    licence: str
    input: str
    labels: str


def registry(file: Path | None = None) -> tuple[RegisteredDetector, ...]:
    """The detectors of the registry file."""
    path = file or data_directory() / "detectors.toml"
    entries = tomllib.loads(path.read_text(encoding="utf-8"))
    return tuple(RegisteredDetector(name, *(entry[field] for field in _FIELDS)) for name, entry in entries.items())


def registered(name: str) -> RegisteredDetector:
    """The detector of a name; BadScene where there is no such name."""
    for entry in registry():
        if entry.name == name:
            return entry
    raise BadScene.at(
        name, "--detector", f"an ONNX file, or a name of the registry; {how_to_get_one()}", told("neither")
    )


def downloaded(entry: RegisteredDetector) -> Path:
    """The detector's file in the cache, fetched and checked against its sha256 where it is not there yet.

    Raises
    ------
    BadScene
        The registry states no sha256, the download fails, or the file is another one.
    """
    if not entry.url or not entry.sha256:
        expected = "an address and a sha256 in detectors.toml, to be filled in by a maintainer"
        raise BadScene.at(entry.name, "--detector", expected, told("none"))
    try:
        import pooch
    except ImportError:
        expected = "pooch for downloads (pip install 'metric-tree[build]')"
        raise BadScene.at(entry.name, "--detector", expected, told("not installed")) from None
    folder = pooch.os_cache("metric-tree") / "detectors"
    try:
        kept = pooch.create(folder, "", env=CACHE_VARIABLE).abspath
        return Path(pooch.retrieve(entry.url, f"sha256:{entry.sha256}", f"{entry.name}.onnx", kept))
    except (OSError, ValueError) as fault:  # no network (requests' errors are OSErrors), or another checksum
        line = (str(fault).splitlines() or [type(fault).__name__])[0]
        expected = f"a download of {entry.url} with sha256 {entry.sha256}"
        raise BadScene.at(entry.name, "--detector", expected, told(line)) from None


def how_to_get_one() -> str:
    """One sentence on where a detector comes from, for those who have none."""
    own = "--images DIR --detector model.onnx makes them with a Mask R-CNN of your own"
    ready = [entry for entry in registry() if entry.url and entry.sha256]
    if not ready:
        return own
    first = ready[0]
    return f"{own}, --detector {first.name} with an open one from {first.url} (sha256 {first.sha256})"
