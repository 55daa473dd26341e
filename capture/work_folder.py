"""The work folder: every stage's output whole or absent, with a stamp of what it was made from."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from metric_base.errors import InputError, Unquoted
from metric_base.files import sole_holder, whole_file

#: Changed whenever a stage makes something else of the same inputs, so that old outputs are made again.
VERSION = 9
STAMPS = "stamps"
_LOCK = ".lock"
#: What the names of our temporary files and folders begin with.
_PART = ".metric-tree."
_CHUNK = 1 << 22
#: Bytes free on a disk that is full: less than a block or two is left over.
_NO_ROOM = 1 << 16


class WorkFolder:
    """A folder that one run at a time works in; a run that was killed leaves nothing half-made behind.

    path : the folder; seconds, processor_s : wall and processor time of each stage that this run made, by name.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.seconds: dict[str, float] = {}
        self.processor_s: dict[str, float] = {}

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Hold the folder; the system frees it when the process ends, however it ends.

        Raises
        ------
        InputError
            Another run holds it, or it cannot be made.
        """
        try:
            (self.path / STAMPS).mkdir(parents=True, exist_ok=True)
            with sole_holder(self.path / _LOCK):
                self._clear_leftovers()
                yield
        except BlockingIOError:
            in_use = Unquoted("one in use by another run")
            raise InputError.at(self.path, "--work", "a folder of its own", in_use) from None
        except OSError as error:
            file = Path(os.fsdecode(error.filename)) if isinstance(error.filename, str | bytes) else self.path
            if not file.absolute().is_relative_to(self.path.absolute()):
                raise  # of an input or another output
            words = error.strerror or "an error"
            raise InputError.at(self.path, "--work", "a folder that can be written", Unquoted(words)) from None

    def stage(self, name: str, inputs: Mapping[str, Any], outputs: Sequence[str], make: Callable[[Path], None]) -> str:
        """Make the outputs of a stage unless they are there, made from the same inputs; their digest.

        inputs : what the outputs depend on, as JSON; outputs : files and folders, relative to the work folder, that
        `make` writes under the same names in the empty folder it is given. An output that it does not write is absent.
        """
        key = _key(name, inputs)
        if self.is_made(name, inputs):
            stamp = self._stamp(name)
            self.processor_s[name] = float(stamp.get("cpu_seconds", 0.0))
            return str(stamp["digest"])
        self.check_ownership({name: outputs})
        started, cpu = time.perf_counter(), sum(os.times()[:4])
        part = self.path / f"{_PART}{name}.part"
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir()
        try:
            make(part)
            made = [output for output in outputs if (part / output).exists()]
            digests = {output: content_digest(part / output) for output in made}
            # a kill from here on leaves a stamp without a key: what stands there is ours, and is made again
            before = {output: {*owned} for output, owned in self._own_digests(name).items()}
            both = {output: sorted(before.get(output, set()) | {digest}) for output, digest in digests.items()}
            self._write_stamp(name, {"key": None, "outputs": [], "owned": {**self._own_digests(name), **both}})
            for output in outputs:
                self._publish(part / output, self.path / output)
        except BaseException as error:
            full = shutil.disk_usage(self.path).free < _NO_ROOM
            shutil.rmtree(part, ignore_errors=True)  # half a stage is nobody's
            if full and isinstance(error, OSError) and error.errno is None:  # COLMAP's writers do not say why
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path)) from error
            raise
        shutil.rmtree(part, ignore_errors=True)
        digest = _digest_of(b"".join(digests[output].encode() for output in made))
        self.seconds[name] = round(time.perf_counter() - started, 3)
        row = {"key": key, "outputs": made, "digest": digest, "seconds": self.seconds[name]}
        row["owned"] = {output: [value] for output, value in digests.items()}
        cpu_s = round(sum(os.times()[:4]) - cpu, 3)  # of all threads and processes that it started
        row["cpu_seconds"] = cpu_s
        self.processor_s[name] = cpu_s
        self._write_stamp(name, row)
        return digest

    def is_made(self, name: str, inputs: Mapping[str, Any]) -> bool:
        """Whether the outputs of a stage are there, made from these inputs."""
        stamp = self._stamp(name)
        return stamp.get("key") == _key(name, inputs) and all((self.path / one).exists() for one in stamp["outputs"])

    def check_ownership(self, stages: Mapping[str, Sequence[str]]) -> None:
        """See that stages would replace nothing but what they wrote themselves.

        stages : outputs by the name of the stage.

        Raises
        ------
        InputError
            There is a file or folder that the stage did not write, or that was changed since.
        """
        for name, outputs in stages.items():
            owned = self._own_digests(name)
            for output in outputs:
                place = self.path / output
                if not os.path.lexists(place):
                    continue
                if output not in owned:
                    state = "it already exists and is not of an earlier run"
                elif place.is_symlink() or (owned[output] and content_digest(place) not in owned[output]):
                    state = "it was changed since the run that wrote it"
                else:
                    continue
                expected = "a folder in which nothing has to be replaced; move it away or choose another folder"
                raise InputError.at(place, "--work", expected, Unquoted(state))

    def discard(self, name: str, outputs: Sequence[str]) -> None:
        """Remove the outputs of a stage, which must be its own."""
        self.check_ownership({name: outputs})
        for output in outputs:
            _remove(self.path / output)
        self._stamp_file(name).unlink(missing_ok=True)

    def discard_stale(self, name: str, inputs: Mapping[str, Any], outputs: Sequence[str]) -> None:
        """Remove the outputs of a stage that is not asked for now and was made from other inputs."""
        stamp = self._stamp(name)
        if stamp and stamp.get("key") != _key(name, inputs):
            self.discard(name, outputs)

    def _own_digests(self, name: str) -> dict[str, list[str]]:
        """The digests that each output of a stage may have; empty in a stamp of an older version."""
        stamp = self._stamp(name)
        owned = stamp.get("owned")
        return owned if isinstance(owned, dict) else {output: [] for output in stamp.get("outputs", [])}

    def _write_stamp(self, name: str, row: Mapping[str, Any]) -> None:
        with whole_file(self._stamp_file(name)) as file:
            file.write_text(json.dumps(row) + "\n", encoding="utf-8")

    def _publish(self, made: Path, place: Path) -> None:
        """Move what was made to its place, whole; what was there before goes first."""
        if os.path.lexists(place):
            old = self.path / f"{_PART}old.part"
            _remove(old)
            place.replace(old)  # a folder that is half removed would be nobody's
            _remove(old)
        if made.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            made.replace(place)

    def _stamp_file(self, name: str) -> Path:
        return self.path / STAMPS / f"{name}.json"

    def _stamp(self, name: str) -> dict[str, Any]:
        try:
            row = json.loads(self._stamp_file(name).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return row if isinstance(row, dict) and isinstance(row.get("outputs"), list) else {}

    def _clear_leftovers(self) -> None:
        """What a killed run left: its parts, and nothing else."""
        for folder, names in ((self.path, f"{_PART}*.part"), (self.path / STAMPS, ".*.part")):
            for entry in folder.glob(names):
                _remove(entry)


def content_digest(path: Path) -> str:
    """A digest of a file's bytes, or of a folder's files with their names."""
    if path.is_file():
        state = hashlib.sha256()
        with path.open("rb") as file:
            while chunk := file.read(_CHUNK):
                state.update(chunk)
        return state.hexdigest()
    parts = [f"{file.relative_to(path)}:{content_digest(file)}" for file in sorted(path.rglob("*")) if file.is_file()]
    return _digest_of("\n".join(parts).encode())


def _key(name: str, inputs: Mapping[str, Any]) -> str:
    return _digest_of(json.dumps([VERSION, name, inputs], sort_keys=True).encode())


def _digest_of(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _remove(place: Path) -> None:
    if place.is_dir() and not place.is_symlink():
        shutil.rmtree(place)
    else:
        place.unlink(missing_ok=True)
