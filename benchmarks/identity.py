"""Digests of the results of all three programs, to prove that a refactoring changes none of them.

    python -m benchmarks.identity --out before.json [--checkout DIR] [--parts scenes queries ... | all]
    python -m benchmarks.identity --against before.json [--parts ...] [--cases 'scenes/demo_room*'] [--wording]

The first command runs the cases of `PARTS` and writes their results; the second runs them again and prints every
difference. Its exit status is 1 if a result differs. Cases use the three programs (`metric_cli.programs`) and the
public API (`metric_tree.open`) in processes of their own, so the same script also runs an old `--checkout`.

There are three kinds of entries:

result   compared exactly: exit status, JSON and CSV on standard output, content of written files. Images and videos
         are compared by pixels, glTF by its JSON and its buffers, Parquet by columns, JSON by values. Seconds and
         the paths of the checkout and of the output folder are removed.
near     numbers that may differ by `TOLERANCE`: a capture from the start.
wording  messages, tables for people, sentences in JSON (`PROSE`), and the bytes of the files. They are counted,
         listed with `--wording`, and never fail.

pycolmap writes the images to its database in the order in which its threads finish. This order changes the numbers of
the images, and with them the model: usually in the seventh digit, in 2 of 17 runs by more than 0.1 %, and once the
choice of the camera model. From stored features on, a capture is exact. `--works DIR` names a folder of finished work
folders for this, one per line of `CAPTURES`; missing ones are made by the checkout. A copy without the stages after
the features is the start of the captures, a complete copy that of insertions into a video. Both runs must use the same
folder; the file of results states it. Without it there are no such cases.

`--keep DIR` keeps all outputs there, so that two runs can be compared with `diff -r`. Without WordNet
(`METRIC_TREE_WORDNET`) there is no `build`, without Blender no Cycles, without `../shared/data` no case that reads it.
"""

from __future__ import annotations

import argparse
import difflib
import fnmatch
import gzip
import hashlib
import json
import os
import re
import shlex
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import av
import cv2
import numpy as np
import pyarrow.parquet

from benchmarks.common import ROOT, options_parser
from benchmarks.identity_cases import CAPTURES, PARTS, Case

#: Parts that together take five minutes on two cores; `pages`, `site` and `dense` take four more.
DEFAULT_PARTS = ["commands", "queries", "scenes", "insertion", "build", "capture", "models"]
#: Maximum relative difference of a `near` number: 11 captures of `demo_video` by one version differ by up to 0.4 %.
TOLERANCE = 1e-2
#: Maximum length of a stored value in characters, so that the file has a few megabytes; longer values are digests only.
MAX_STORED = 20_000
#: Maximum number of files that are entries of their own; a larger folder is one entry per subfolder and suffix.
MAX_FILES = 200
#: Maximum number of lines that explain a difference.
MAX_LINES = 6
#: Keys of JSON results whose values are times.
VOLATILE = {"seconds", "cpu_seconds", "retrieved_at"}
#: Keys of JSON results whose values are sentences for people (or codes, which are single words): sentences are wording.
PROSE = {"notes", "warnings", "cautions", "reason", "message", "headline", "formula", "description", "summary"}
PROSE |= {"category_from", "why"}
#: Files of the stages up to the features in a work folder.
FEATURES = ["frames*", "databases", "features.*", "stamps", "*.jpg", "*.png"]
#: Files of a work folder that are no results: databases and stamps of the stages, the frames and their list.
INTERNAL = {"databases", "stamps", "frames", "frames.json", ".lock"}
#: A line of progress, whose number depends on the time: `features: 16 of 20`.
PROGRESS = re.compile(r"[a-z ]+: [\d,]+( of [\d,]+)?")
SECONDS = re.compile(r"\b[\d.]+ s\b")
#: Time limit of a case in seconds.
LIMIT_S = 900
#: Start of a program as its console script starts it.
START = "import sys; from metric_cli import programs; sys.exit(programs.{}())"

Entries: TypeAlias = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Outcome:
    """A finished case: exit status, standard output and errors without paths, and the folder of its files."""

    case: Case
    status: int
    output: str
    errors: str
    folder: Path


class Runner:
    """Runs cases in a checkout; outputs go to a folder per case."""

    def __init__(self, checkout: Path, outputs: Path, works: Path | None) -> None:
        self.checkout = checkout
        self.outputs = outputs
        self.works = works
        home = outputs / "home"
        home.mkdir(parents=True, exist_ok=True)
        kept = {name: value for name, value in os.environ.items() if name != "METRIC_TREE_PATH"}
        self.environment = kept | {"PYTHONPATH": str(checkout), "HOME": str(home), "SOURCE_DATE_EPOCH": "1767225600"}
        self.environment |= {"XDG_CACHE_HOME": str(home), "COLUMNS": "120", "PYTHONDONTWRITEBYTECODE": "1"}

    def outcome(self, case: Case) -> Outcome:
        """Run one case."""
        folder = self.outputs / case.name
        folder.mkdir(parents=True)
        if case.work and self.works:
            ignored = _later_stages if case.features_only else None
            shutil.copytree(self.works / case.work, folder / "work", ignore=ignored)
        words = [word.replace("{out}", str(folder)) for word in case.words]
        code = case.code or START.format(case.program)
        command = [sys.executable, "-c", code, *words]
        run = subprocess.run(
            command, cwd=self.checkout, env=self.environment, capture_output=True, timeout=LIMIT_S, check=False
        )
        texts = [self.without_paths(data, folder).decode("utf-8", "replace") for data in (run.stdout, run.stderr)]
        return Outcome(case, run.returncode, texts[0], texts[1], folder)

    def make_work(self, name: str) -> None:
        """Run the capture of a work folder that does not exist; it may end without a scale."""
        if self.works and not (self.works / name).exists():
            words = [*shlex.split(CAPTURES[name]), "--work", str(self.works / name)]
            command = [sys.executable, "-c", START.format("estimate_scale"), *words]
            subprocess.run(command, cwd=self.checkout, env=self.environment, capture_output=True, check=False)

    def without_paths(self, data: bytes, folder: Path) -> bytes:
        """Replace the output folder and the checkout by names."""
        return data.replace(str(folder).encode(), b"OUT").replace(str(self.checkout).encode(), b"ROOT")

    def entries(self, outcome: Outcome) -> Entries:
        """Entries of a finished case, by name."""
        name, case = outcome.case.name, outcome.case
        made: Entries = {f"{name}:status": _entry("result", outcome.status)}
        messages = [line for line in outcome.errors.splitlines() if not PROGRESS.fullmatch(line)]
        if messages:
            made[f"{name}:errors"] = _entry("wording", messages)
        values = _json_values(outcome.output)
        if values is None and "--csv" in case.words:
            values = outcome.output
        if case.fresh:
            return made | _fresh_entries(outcome, values)
        if values is None and outcome.output:
            made[f"{name}:output"] = _entry("wording", SECONDS.sub("N s", outcome.output).splitlines())
        elif case.split and isinstance(values, dict):
            made |= {f"{name}:{key}": _entry("result", value) for key, value in values.items()}
        elif values is not None:
            made[f"{name}:output"] = _entry("result", values)
        return made | self._file_entries(outcome)

    def _file_entries(self, outcome: Outcome) -> Entries:
        """Content of the files that a case wrote (result), and their bytes (wording)."""
        folder, name = outcome.folder, outcome.case.name
        contents: dict[str, Any] = {}
        sums = {}
        for file in sorted(file for file in folder.rglob("*") if file.is_file()):
            inside = file.relative_to(folder)
            if inside.parts[0] == "work" and (not outcome.case.features_only or inside.parts[1] in INTERNAL):
                continue
            data = self.without_paths(file.read_bytes(), folder)
            contents[inside.as_posix()] = file_content(file, data)
            # Matroska files contain a random identifier.
            if file.suffix != ".mkv" and not any(f'"{key}"'.encode() in data for key in VOLATILE):
                sums[inside.as_posix()] = _digest(data)[:12]
        if not contents:
            return {}
        if len(contents) > MAX_FILES:
            groups: dict[str, Any] = {}
            for path, content in contents.items():
                group = "/".join([*Path(path).parent.parts[:2], f"*{Path(path).suffix}"])
                groups.setdefault(group, []).append([path, content])
            return {f"{name}/{group}": _entry("result", content) for group, content in groups.items()}
        made = {f"{name}/{path}": _entry("result", content) for path, content in contents.items()}
        return made | {f"{name}:bytes": _entry("wording", [f"{path} {value}" for path, value in sums.items()])}


def file_content(file: Path, data: bytes) -> Any:
    """Return what a file contains, without its encoding, as JSON values; the digest of `data` for unknown formats.

    Parameters
    ----------
    file : written file.
    data : its bytes, without paths of this run.
    """
    read: Callable[[], Any] = {
        ".gz": lambda: _digest(gzip.decompress(file.read_bytes())),
        ".json": lambda: _json_values(data.decode()),
        ".jsonl": lambda: _json_values(data.decode()),
        ".png": lambda: _image_content(data),
        ".webp": lambda: _image_content(data),
        ".glb": lambda: _gltf_content(data),
        ".mp4": lambda: _video_content(file),
        ".mkv": lambda: _video_content(file),
        ".parquet": lambda: _table_content(file),
    }.get(file.suffix.lower(), lambda: _digest(data))
    return read()


def _image_content(data: bytes) -> list[Any]:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        return ["not an image", _digest(data)]
    return [image.shape, image.dtype.name, _digest(image.tobytes())]


def _gltf_content(data: bytes) -> list[Any]:
    """JSON of a GLB, and the digest of its buffer."""
    end = 20 + int.from_bytes(data[12:16], "little")
    return [json.loads(data[20:end]), _digest(data[end:])]


def _video_content(file: Path) -> list[Any]:
    with av.open(str(file)) as video:
        return [
            (frame.pts, frame.format.name, _digest(frame.to_ndarray().tobytes())) for frame in video.decode(video=0)
        ]


def _table_content(file: Path) -> dict[str, Any]:
    table = pyarrow.parquet.read_table(file)
    return {column: [str(table[column].type), table[column].to_pylist()] for column in table.column_names}


def _fresh_entries(outcome: Outcome, values: Any) -> Entries:
    """Return the exact and the near entries of a capture from the start.

    Exact are the features by name of the image, the names of the written files and of the frames. Near are the focal
    length, and the poses without their similarity: the angles between consecutive cameras (by their cosine), and the
    distances between their centres, divided by the mean distance; and this mean in metres.
    """
    name, folder = outcome.case.name, outcome.folder / "work"
    written = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    poses = json.loads((folder / "frame_poses.json").read_text())
    rotations = np.array([frame["rotation"] for frame in poses["frames"]])
    centres = -np.einsum("nji,nj->ni", rotations, np.array([frame["translation"] for frame in poses["frames"]]))
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    turns = (np.einsum("nij,nij->n", rotations[:-1], rotations[1:]) - 1) / 2
    near = {"focal": poses["camera"]["params"][0], "steps": list(steps / steps.mean()), "turns": list(turns)}
    near["step_m"] = values["scale"] * steps.mean()
    query = (
        "SELECT name, k.data, d.data FROM images JOIN keypoints k USING (image_id) JOIN descriptors d USING (image_id)"
    )
    with closing(sqlite3.connect(folder / "databases/features.db")) as database:
        features = sorted((image, _digest(points), _digest(words)) for image, points, words in database.execute(query))
    return {
        f"{name}:files": _entry("result", written),
        f"{name}:frames": _entry("result", [[frame["name"], frame["origin"]] for frame in poses["frames"]]),
        f"{name}:features": _entry("result", features),
        f"{name}:model": _entry("near", near),
    }


def differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[tuple[str, str, list[str]]]:
    """Yield name, kind and explanation of every entry that differs."""
    for name in sorted({**before, **after}):
        old, new = before.get(name), after.get(name)
        if old is None or new is None:
            yield name, (old or new or {})["kind"], ["only before" if new is None else "only after"]
        elif new["kind"] == "near":
            worst = max(_relative_differences(old["value"], new["value"]), default=0.0)
            if not worst <= TOLERANCE:
                yield name, "near", [f"relative difference {worst:.2g}, more than {TOLERANCE:.2g}"]
        else:
            for key, kind in (("digest", new["kind"]), ("sentences", "wording")):
                if old.get(key) != new.get(key):
                    shown = "value" if key == "digest" else "sentences"
                    yield name, kind, _changed_lines(old.get(shown), new.get(shown))


def _changed_lines(old: Any, new: Any) -> list[str]:
    """Lines of two values that differ, as in a unified diff."""
    texts = [json.dumps("not stored" if value is None else value, indent=1).splitlines() for value in (old, new)]
    lines = difflib.unified_diff(texts[0], texts[1], lineterm="", n=0)
    return [line[:240] for line in lines if not line.startswith(("---", "+++", "@@"))]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases; write or compare."""
    parser = options_parser(__doc__)
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--out", type=Path, metavar="FILE", help="write the entries to this JSON file")
    action.add_argument("--against", type=Path, metavar="FILE", help="compare with the entries in this file")
    parser.add_argument("--checkout", type=Path, default=ROOT, metavar="DIR", help="checkout to run (default: this)")
    parser.add_argument("--parts", nargs="+", choices=[*PARTS, "all"], default=DEFAULT_PARTS, help="%(default)s")
    parser.add_argument("--cases", default="*", metavar="GLOB", help="only cases whose name matches")
    parser.add_argument("--works", type=Path, metavar="DIR", help="finished work folders (default: those of --against)")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="cases at a time (default: %(default)s)")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep the outputs of the cases in a new folder")
    parser.add_argument("--wording", action="store_true", help="also print the differences in wording")
    options = parser.parse_args(arguments)
    options.parts = list(PARTS) if "all" in options.parts else options.parts
    if options.keep and options.keep.exists():
        parser.error(f"--keep: {options.keep} exists")
    before = json.loads(options.against.read_text()) if options.against else {"works": None, "cases": {}}
    works = options.works or (Path(before["works"]) if before["works"] else None)
    outputs = options.keep.resolve() if options.keep else Path(tempfile.mkdtemp(prefix="identity-"))
    try:
        made = _run_parts(Runner(options.checkout.resolve(), outputs, works and works.resolve()), options)
    finally:
        if not options.keep:
            shutil.rmtree(outputs, ignore_errors=True)
    if options.against:
        selected = {name: entries for name, entries in before["cases"].items() if _selected(name, options)}
        return _compare(selected, made, options.wording)
    report = {"works": str(works.resolve()) if works else None, "cases": made}
    options.out.write_text(json.dumps(report, indent=0, sort_keys=True) + "\n")
    print(f"{options.out}: {sum(map(len, made.values())):,} entries of {len(made)} cases")
    return 0


def _run_parts(runner: Runner, options: argparse.Namespace) -> dict[str, Entries]:
    """Entries by case, with a line of progress per part."""
    made: dict[str, Entries] = {}
    for part in options.parts:
        started = time.monotonic()
        cases = [case for case in PARTS[part](runner.checkout) if _selected(case.name, options)]
        cases = [case for case in cases if not case.work or runner.works]
        for work in {case.work for case in cases if case.work}:
            runner.make_work(work)
        with ThreadPoolExecutor(options.jobs) as pool:
            for outcome in pool.map(runner.outcome, cases):
                made[outcome.case.name] = runner.entries(outcome)
        state = (
            f"{len(cases)} cases, {time.monotonic() - started:.0f} s" if cases else "no case, or its input is missing"
        )
        print(f"{part}: {state}", file=sys.stderr, flush=True)
    return made


def _later_stages(folder: str, names: list[str]) -> set[str]:
    """Names in a work folder that belong to stages after the features."""
    kept = ["frames.json", "features.json"] if Path(folder).name == "stamps" else FEATURES
    return {name for name in names if not any(fnmatch.fnmatch(name, pattern) for pattern in kept)}


def _selected(case: str, options: argparse.Namespace) -> bool:
    return case.partition("/")[0] in options.parts and fnmatch.fnmatch(case, options.cases)


def _compare(before: Mapping[str, Entries], after: Mapping[str, Entries], with_wording: bool) -> int:
    """Print the differences of all cases in `after`, and of those missing there; 1 if a result differs."""
    failed = worded = 0
    for case in sorted({**before, **after}):
        if case not in before or case not in after:
            failed += 1
            print(f"result: {case}: only {'before' if case in before else 'after'}")
            continue
        for name, kind, lines in differences(before[case], after[case]):
            failed += kind != "wording"
            worded += kind == "wording"
            if kind != "wording" or with_wording:
                print(f"{kind}: {name}", *lines[:MAX_LINES], sep="\n    ")
                if len(lines) > MAX_LINES:
                    print(f"    ... {len(lines) - MAX_LINES} more lines")
    compared = sum(len(entries) for case, entries in after.items() if case in before)
    print(f"{compared:,} entries: {failed} results differ, {worded} differ in wording or bytes")
    return 1 if failed else 0


def _entry(kind: str, value: Any) -> dict[str, Any]:
    """An entry with its digest; the value itself if it is short, or if it is compared with a tolerance."""
    sentences: list[str] = []
    text = json.dumps(_comparable(value, sentences), sort_keys=True, default=str)
    entry: dict[str, Any] = {"kind": kind, "digest": _digest(text.encode())}
    if kind == "near" or len(text) <= MAX_STORED:
        entry["value"] = json.loads(text)
    if sentences:
        entry["sentences"] = sentences if len(str(sentences)) <= MAX_STORED else _digest(str(sentences).encode())
    return entry


def _comparable(value: Any, sentences: list[str], key: str = "") -> Any:
    """The value without times, and with its sentences moved to a list, at every depth."""
    if isinstance(value, dict):
        return {name: _comparable(part, sentences, name) for name, part in value.items() if name not in VOLATILE}
    if isinstance(value, list):
        return [_comparable(part, sentences, key) for part in value]
    if key in PROSE and isinstance(value, str) and value.count(" ") > 1:
        sentences.append(value)
        return "a sentence"
    return value


def _json_values(text: str) -> Any:
    """The JSON value of a text, or those of its lines; None if it is no JSON object or array."""
    if not text.startswith(("{", "[")):
        return None
    try:
        return json.loads(text)
    except ValueError:
        pass
    try:
        return [json.loads(line) for line in text.splitlines()]
    except ValueError:
        return None


def _relative_differences(old: Any, new: Any) -> Iterator[float]:
    """Relative differences of the numbers in two values; infinity if their forms differ."""
    if isinstance(old, dict) and isinstance(new, dict) and old.keys() == new.keys():
        for key in old:
            yield from _relative_differences(old[key], new[key])
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for pair in zip(old, new, strict=True):
            yield from _relative_differences(*pair)
    elif isinstance(old, int | float) and isinstance(new, int | float):
        yield abs(old - new) / max(abs(old), abs(new), 1e-12)
    else:
        yield float("inf")


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
