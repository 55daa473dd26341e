"""Captures next to plain pycolmap: `python -m benchmarks.estimator.real_footage DATA --out DIR --against pycolmap`.

DATA is the folder that holds `captures/` and `scenes/`. Every case (a set, with `--parts` also the parts of the sets,
with `--made` also the rendered captures and the constructed errors; see `footage_cases`) is reconstructed in a process
of its own, and with `--against pycolmap` by plain pycolmap on the same frames right after it (`plain_colmap`). The
results are `DIR/NAME.json` and `DIR/NAME.plain.json`; those that exist are kept, so that a run can be continued.

The judged results of the last run of each case are in `footage_rows.csv`, whether DIR still exists or not. `--write`
replaces there the cases that DIR holds, and writes the tables of docs/evidence/videos.md from it; `--gates` prints the
rates of the gates.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.child import ChildRun, run_child
from benchmarks.common import write_between
from benchmarks.estimator.footage_cases import (
    FootageCase,
    made_cases,
    make_input,
    part_cases,
    read_reference,
    set_cases,
)
from benchmarks.estimator.footage_judging import Row, conditions, gate_table, gates_of, judged, summary_rows, table
from benchmarks.estimator.footage_rows import ROWS, read_rows, updated_rows, write_rows
from benchmarks.estimator.plain_colmap import camera_path
from capture.mapping.refusals import MAX_CONTRADICTED_RATIO, MIN_BROKEN_FRAMES
from capture.mapping.triplets import TripletAgreement
from estimator.records.result import ScaleEvidence

__all__ = ["main", "sensor_rows"]

#: Seconds between the frames of `walk_carpark/video.mp4`.
FRAME_S = 1001 / 30000
PAGE = Path("docs/evidence/real_footage.md")
AGAINST_PAGE = Path("docs/evidence/videos.md")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, metavar="DATA")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="results, which a later run continues")
    parser.add_argument("--against", choices=["pycolmap"], help="run plain pycolmap on the same frames, too")
    parser.add_argument("--parts", action="store_true", help="also the parts of the sets")
    parser.add_argument("--made", action="store_true", help="also rendered captures and constructed errors")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only these cases, of any kind, in this order")
    parser.add_argument("--limit-s", type=float, default=1800, help="seconds for one case (default: %(default)s)")
    parser.add_argument("--write", action="store_true", help=f"write the tables of {AGAINST_PAGE} from the results")
    parser.add_argument("--gates", action="store_true", help="print the rates of the gates from the results")
    parser.add_argument("--planted", action="store_true", help="a wrong piece in every set's model that --out holds")
    parser.add_argument("--sensors", action="store_true", help="the inertial unit and GPS of walk_carpark alone")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    sets = set_cases(options.data)
    if options.sensors:
        write_between(PAGE, "sensors", _sensors(options.data / "scenes" / "walk_carpark"))
        return
    if options.planted:
        write_between(PAGE, "planted", _planted(options.out, sets))
        return
    cases = [*sets, *part_cases(sets), *made_cases()]
    if options.write or options.gates:
        fresh = [row for case in cases if (row := _row(case, options.out)) is not None]
        rows = updated_rows(read_rows(ROWS), fresh)
        if options.gates:
            print(gate_table(rows))
        if options.write:
            write_rows(rows, ROWS)
            summary = f"{summary_rows(rows)}\n\n{conditions(rows, cases)}"
            write_between(AGAINST_PAGE, "summary against pycolmap", summary)
            write_between(AGAINST_PAGE, "against pycolmap", table(rows))
            write_between(AGAINST_PAGE, "gates", gate_table(rows))
        return
    groups = {"set"} | ({"part"} if options.parts else set())
    groups |= {"choosing", "reported", "error"} if options.made else set()
    by_name = {case.name: case for case in cases}
    chosen = [by_name[name] for name in options.only or [case.name for case in cases if case.group in groups]]
    if options.one:
        print(json.dumps(_reconstruct(chosen[0], options.out)))
        return
    for case in chosen:
        _run(case, options)


def _run(case: FootageCase, options: argparse.Namespace) -> None:
    """Run what has no result of a case yet: ours, and plain pycolmap if it is compared."""
    if not (options.out / f"{case.name}.json").is_file():
        _run_ours(case, options.data, options.out, options.limit_s)
    if options.against is not None and not (options.out / f"{case.name}.plain.json").is_file():
        _run_plain(case, options.out, options.limit_s)
    if case.group != "set":  # the models of sets stay for --planted
        shutil.rmtree(options.out / "work" / case.name, ignore_errors=True)


def _run_ours(case: FootageCase, data: Path, out: Path, limit_s: float) -> None:
    """Reconstruct a case in a separate process, and keep the result."""
    words = ["-m", "benchmarks.estimator.real_footage", str(data), "--out", str(out), "--only", case.name, "--one"]
    run = run_child([sys.executable, *words], limit_s)
    result = _result(run, {"code": "no answer", "frames": 0})
    (out / f"{case.name}.json").write_text(json.dumps(result) + "\n", encoding="utf-8")
    if run.status:
        (out / f"{case.name}.log").write_text(run.errors, encoding="utf-8")
    print(case.name, _shown(case, result, out), flush=True)


def _run_plain(case: FootageCase, out: Path, limit_s: float) -> None:
    """Run plain pycolmap on the images of a case, or on the frames that ours chose of a video, and keep the result."""
    images = make_input(case, out / "inputs" / case.name)
    images = images if images.is_dir() else out / "work" / case.name / "frames"
    with tempfile.TemporaryDirectory() as scratch:
        run = run_child([sys.executable, "-m", "benchmarks.estimator.plain_colmap", str(images), scratch], limit_s)
    result = _result(run, {"frames": 0})
    (out / f"{case.name}.plain.json").write_text(json.dumps(result) + "\n", encoding="utf-8")
    print(case.name, "plain", _shown(case, result, out), flush=True)


def _result(run: ChildRun, nothing: dict[str, Any]) -> dict[str, Any]:
    """Return the result that a run printed; without one, no model and the time of the run."""
    lines = run.output.splitlines()
    if run.status == 0 and lines:
        return dict(json.loads(lines[-1]))
    nothing = nothing | {"placed": 0, "centres": {}, "focal": None, "metrics": None, "status": run.status}
    return nothing | {"wall_s": round(run.wall_s, 1), "cpu_s": round(run.cpu_s, 1)}


def _shown(case: FootageCase, result: dict[str, Any], out: Path) -> str:
    """Return the result of a case in a line."""
    judgement = judged(result, read_reference(case, out / "inputs"), case)
    kept = ("code", "frames", "focal", "wall_s", "cpu_s", "load")
    return f"{judgement} {[result.get(key) for key in kept]}"


def _row(case: FootageCase, out: Path) -> Row | None:
    """Return the row of a case, None if ours has not been run."""
    own, plain = out / f"{case.name}.json", out / f"{case.name}.plain.json"
    if not own.is_file():
        return None
    reference = read_reference(case, out / "inputs")
    focal = None if reference is None else reference.focal
    results = [json.loads(file.read_text(encoding="utf-8")) for file in (own, plain) if file.is_file()]
    judgements = [judged(result, reference, case) for result in results]
    for result in results:
        n_frames, is_held = result.get("frames", 0), bool(result.get("held"))
        result["gates"] = gates_of(result["metrics"], n_frames, is_held) if result.get("metrics") else None
    ours, other = (*results, None)[:2]
    return Row(case, ours, judgements[0], other, judgements[1] if other is not None else None, focal)


def _reconstruct(case: FootageCase, out: Path) -> dict[str, Any]:
    """Reconstruct a case, and return its outcome with the camera centres of the best model, also of a refused one."""
    from capture.mapping.features import STRATEGIES
    from capture.mapping.refusals import CaptureFailure
    from capture.mapping.worker import processor_s
    from capture.pipeline import CaptureOptions, reconstruct
    from capture.work_folder import WorkFolder

    source = make_input(case, out / "inputs" / case.name)
    folder = out / "work" / case.name
    shutil.rmtree(folder, ignore_errors=True)
    work = WorkFolder(folder)
    search: Any = import_module("capture.mapping.search")
    make_model, paths = search.make_model, {}

    def make_model_and_keep(output: Path, *words: Any, **options: Any) -> None:
        """Make a model; read the last model of the mapping if it is refused, because the capture deletes it."""
        make_model(output, *words, **options)
        models = [] if output.exists() else list(output.parent.rglob("models/*/images.bin"))
        if models:
            paths[output.name] = camera_path(max(models, key=lambda file: file.stat().st_mtime).parent)

    search.make_model = make_model_and_keep
    started, cpu, failure = time.perf_counter(), processor_s(), None
    with work.lock():
        try:
            reconstruct(source, work, CaptureOptions(camera_model=case.camera_model))
        except CaptureFailure as refusal:
            failure = refusal.failure
    times = {"wall_s": round(time.perf_counter() - started, 1), "cpu_s": round(processor_s() - cpu, 1)}
    report, summary = (
        json.loads((folder / name).read_text(encoding="utf-8")) for name in ("reconstruction.json", "capture.json")
    )
    suffixes = {row.name: row.suffix for row in STRATEGIES}
    path: dict[str, Any] = {"placed": 0, "centres": {}, "focal": None}
    if failure is None:
        path = camera_path(folder / "sparse" / "0")
    else:
        path = paths.get(f"model{suffixes[summary['strategy']]}", path)
    commit = subprocess.run(
        ["git", "log", "-1", "--format=%h", "--", "capture"], capture_output=True, text=True, check=False
    )
    return {
        "code": None if failure is None else failure.code,
        "message": None if failure is None else failure.message,
        **path,
        "frames": report["pairs"]["frames"],
        "overruled": report["overruled"],
        "held": report["focal_held"],
        "strategy": summary["strategy"],
        "tried": summary["strategies"],
        "metrics": report["model"],
        **times,
        "stages_s": work.seconds,
        "load": round(os.getloadavg()[0], 1),
        "commit": commit.stdout.strip(),
    }


def sensor_rows(place: Path) -> list[tuple[str, ScaleEvidence]]:
    """What inertial unit and GPS of a video say of the reference model, by the whole path and its halves.

    place : a set with `video.mp4`, whose reference model has images named by the video's frames, from 1.
    """
    from estimator.evidence.gps import VideoGps
    from estimator.evidence.imu import Imu
    from estimator.evidence.source import CameraPath
    from estimator.pipeline import measure_objects
    from estimator.reconstructions.colmap import read_colmap
    from estimator.telemetry.readers import read_telemetry

    video = place / "video.mp4"
    telemetry = read_telemetry(video)
    assert telemetry.positions is not None
    scene = read_colmap(place / "sparse" / "0")
    numbers = np.array([int(Path(view.name).stem) - 1 for view in scene.views])
    order = np.argsort(numbers)
    times, centres = numbers[order] * FRAME_S, np.array([view.centre for view in scene.views])[order]
    half = len(times) // 2
    rows, measurements = [], measure_objects(scene, ())
    for part, some in {"whole": slice(None), "first half": slice(0, half), "second half": slice(half, None)}.items():
        path = CameraPath(times[some], centres[some])
        for source in (Imu(telemetry, path, video.name), VideoGps(telemetry.positions, path, video.name)):
            (row,) = source.observe(scene, measurements)
            rows.append((part, row))
    return rows


def _sensors(place: Path) -> str:
    lines = ["| kind | path | scale | 90 % interval | or why not |", "|---|---|---|---|---|"]
    for part, row in sensor_rows(place):
        if row.scale is None or row.sd_log is None:
            lines.append(f"| `{row.kind}` | {part} | | | {row.reason} |")
            continue
        low, high = row.scale * np.exp(np.array([-1.645, 1.645]) * row.sd_log)
        lines.append(f"| `{row.kind}` | {part} | {row.scale:.3f} | {low:.3f} to {high:.3f} | |")
    return "\n".join(lines)


#: Wrong pieces: a turn in degrees, a shift as a share of the path's extent, and a factor of size.
PLANTS = {"moved by .3": (0.0, 0.3, 1.0), "turned by 5 degrees": (5.0, 0.0, 1.0), "grown by .3": (0.0, 0.0, 1.3)}
#: ... and in the middle sixth of a path: so many times longer steps.
LONGER = {"steps by .3": 1.3, "steps three times": 3.0}


def _planted(out: Path, sets: list[FootageCase]) -> str:
    """Rows of the models as they are, and with their last third as a wrong piece."""
    from capture.mapping.features import STRATEGIES

    suffixes = {row.name: row.suffix for row in STRATEGIES}
    head = ["set", "frames", "contradicted", *PLANTS, *LONGER]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for case in sets:
        file, folder = out / f"{case.name}.json", out / "work" / case.name
        result = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {"code": "not run"}
        if result["code"] is None:
            database = folder / "databases" / f"matches{suffixes[result['strategy']]}.db"
            with tempfile.TemporaryDirectory() as scratch:  # to open a database changes it
                copied = shutil.copy(database, scratch)
                lines.append(f"| `{case.name}` | " + " | ".join(_planted_cells(folder, str(copied))) + " |")
    return "\n".join(lines)


def _planted_cells(folder: Path, database: str) -> list[str]:
    from scipy.spatial.transform import Rotation

    from capture.mapping.triplets import agreement, model_triplets
    from estimator.reconstructions.pycolmap_library import pycolmap
    from tests.synthetic.wrong_pieces import lengthen_steps, move_frames

    model = pycolmap.Reconstruction(folder / "sparse" / "0")
    agreed = agreement(model_triplets(model, database))
    cells = [str(model.num_reg_images()), str(agreed.contradicted)]
    names = sorted(image.name for image in model.images.values() if image.has_pose)
    wrong = set(names[len(names) - len(names) // 3 :])
    for turn_deg, shift, factor in PLANTS.values():
        planted = pycolmap.Reconstruction(folder / "sparse" / "0")
        move_frames(planted, wrong, Rotation.from_euler("y", turn_deg, degrees=True).as_matrix(), shift, factor)
        found = agreement(model_triplets(planted, database))
        kept = set(found.parts[0]) if found.parts else set()
        mixed = min(len(kept & wrong), len(kept - wrong))
        cells.append(f"{_refused(found)}{len(kept)}/{mixed}")
    middle = set(names[len(names) * 5 // 12 : len(names) * 7 // 12])
    for factor in LONGER.values():
        planted = pycolmap.Reconstruction(folder / "sparse" / "0")
        lengthen_steps(planted, middle, factor)
        found = agreement(model_triplets(planted, database))
        cells.append(f"{_refused(found)}{len(found.parts[0]) if found.parts else 0}")
    return cells


def _refused(found: TripletAgreement) -> str:
    ratio = found.contradicted / max(found.triplets, 1)
    wrong = ratio > MAX_CONTRADICTED_RATIO or len(found.broken) >= MIN_BROKEN_FRAMES
    return "refused: " if wrong else ""


if __name__ == "__main__":
    main()
