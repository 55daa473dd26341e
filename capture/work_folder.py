"""Work folder of a capture: the outputs of each stage are complete or absent, with a stamp of their inputs."""

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
from metric_base.files import sole_holder, write_whole

#: Number that is increased when a stage makes other outputs from the same inputs, so that old outputs are replaced.
VERSION = 11
STAMPS = "stamps"
_LOCK = ".lock"
#: Ending of the name of the work folder next to a scene.
WORK_SUFFIX = ".metric-tree"
#: Prefix of temporary files and folders.
_PART = ".metric-tree."
#: Maximum free bytes of a full disk: less than a few blocks.
MAX_FREE_OF_FULL_DISK = 1 << 16


class WorkFolder:
    """A folder in which one run at a time works; a run that is killed leaves no incomplete output.

    Attributes
    ----------
    path : Path
    seconds, processor_s : dict of str to float
        Wall and processor time of the stages of this run, by name.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.seconds: dict[str, float] = {}
        self.processor_s: dict[str, float] = {}

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Lock the folder; the system releases it when the process ends.

        Raises
        ------
        InputError
            Another run has locked it, or it cannot be made.
        """
        try:
            (self.path / STAMPS).mkdir(parents=True, exist_ok=True)
            with sole_holder(self.path / _LOCK):
                for folder, pattern in ((self.path, f"{_PART}*.part"), (self.path / STAMPS, ".*.part")):
                    for entry in folder.glob(pattern):  # of a run that was killed
                        _remove(entry)
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
        """Make the outputs of a stage unless they exist and are made from the same inputs; return their digest.

        Parameters
        ----------
        name : str
        inputs : mapping
            Values that determine the outputs, as JSON.
        outputs : sequence of str
            Files and folders, relative to the work folder.
        make : callable
            Writes the outputs under the same names to an empty folder. Outputs that it does not write are absent.

        Raises
        ------
        InputError
            An output would replace a file that the stage did not write.
        OSError
            The disk is full (`ENOSPC`), or the folder cannot be written.
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
            # a kill from here on leaves a stamp without a key: the outputs belong to the stage and are made again
            owned = self._own_digests(name)
            owned |= {output: sorted({*owned.get(output, ()), digest}) for output, digest in digests.items()}
            self._write_stamp(name, {"key": None, "outputs": [], "owned": owned})
            for output in outputs:
                self.publish(part / output, self.path / output)
        except BaseException as error:
            is_full = shutil.disk_usage(self.path).free < MAX_FREE_OF_FULL_DISK
            shutil.rmtree(part, ignore_errors=True)
            if is_full and isinstance(error, OSError) and error.errno is None:  # an error of COLMAP's writers
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path)) from error
            raise
        shutil.rmtree(part, ignore_errors=True)
        digest = hashlib.sha256(b"".join(digests[output].encode() for output in made)).hexdigest()
        self.seconds[name] = round(time.perf_counter() - started, 3)
        self.processor_s[name] = round(sum(os.times()[:4]) - cpu, 3)  # of all threads and child processes
        row = {
            "key": key,
            "outputs": made,
            "digest": digest,
            "seconds": self.seconds[name],
            "owned": {output: [value] for output, value in digests.items()},
            "cpu_seconds": self.processor_s[name],
        }
        self._write_stamp(name, row)
        return digest

    def is_made(self, name: str, inputs: Mapping[str, Any]) -> bool:
        """Return whether the outputs of a stage exist and are made from these inputs."""
        stamp = self._stamp(name)
        return stamp.get("key") == _key(name, inputs) and all((self.path / one).exists() for one in stamp["outputs"])

    def check_ownership(self, stages: Mapping[str, Sequence[str]]) -> None:
        """Check that stages, given by name with their outputs, would replace only outputs that they wrote.

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
        """Remove the outputs of a stage, which must have written them."""
        self.check_ownership({name: outputs})
        for output in outputs:
            _remove(self.path / output)
        self._stamp_file(name).unlink(missing_ok=True)

    def discard_stale(self, name: str, inputs: Mapping[str, Any], outputs: Sequence[str]) -> None:
        """Remove the outputs of a stage if they are made from other inputs."""
        stamp = self._stamp(name)
        if stamp and stamp.get("key") != _key(name, inputs):
            self.discard(name, outputs)

    def _own_digests(self, name: str) -> dict[str, list[str]]:
        """Return the digests that each output of a stage may have; none in a stamp of an older version."""
        stamp = self._stamp(name)
        owned = stamp.get("owned")
        return owned if isinstance(owned, dict) else {output: [] for output in stamp.get("outputs", [])}

    def _write_stamp(self, name: str, row: Mapping[str, Any]) -> None:
        write_whole(self._stamp_file(name), json.dumps(row) + "\n")

    def publish(self, made: Path, place: Path) -> None:
        """Move an output to its place after removing the previous one."""
        if os.path.lexists(place):
            old = self.path / f"{_PART}old.part"
            _remove(old)
            place.replace(old)  # the place never holds a folder that is partly removed
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


def content_digest(path: Path) -> str:
    """Return a digest of the bytes of a file, or of the files of a folder with their names."""
    if path.is_file():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    parts = [f"{file.relative_to(path)}:{content_digest(file)}" for file in sorted(path.rglob("*")) if file.is_file()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _key(name: str, inputs: Mapping[str, Any]) -> str:
    """Return the digest of the inputs of a stage."""
    return hashlib.sha256(json.dumps([VERSION, name, inputs], sort_keys=True).encode()).hexdigest()


def _remove(path: Path) -> None:
    """Remove a file or a folder, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
