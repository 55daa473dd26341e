"""Real pictures and videos through the capture: `python -m benchmarks.estimator.real_footage DATA --out DIR [--write]`.

DATA is the folder that holds `captures/` and `scenes/` (docs/evidence/real_footage.md says what each set is). Every set
is reconstructed from its pictures or its video in a process of its own, and its cameras are compared with those of the
reference model, after the similarity that brings them nearest. The result of a set is `DIR/NAME.json`; `--write` makes
the tables of the page from these files, with those of `--before DIR` beside them.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.child import run_child
from benchmarks.common import write_between
from capture.mapping.refusals import MAX_CONTRADICTED_RATIO, MIN_BROKEN_FRAMES
from capture.mapping.triplets import TripletAgreement
from estimator.records.result import ScaleEvidence
from metric_base.arrays import FloatArray

__all__ = ["SETS", "FootageSet", "main", "path_error", "sensor_rows"]

#: Seconds between the frames of `walk_carpark/video.mp4`.
FRAME_S = 1001 / 30000
PAGE = Path("docs/evidence/real_footage.md")
AGAINST_PAGE = Path("docs/evidence/videos.md")


@dataclass(frozen=True, slots=True)
class FootageSet:
    """A set of real footage.

    place : below DATA; source : the video or folder of pictures in it; chosen_on : whether options and gates of the
    capture were chosen with it (the others are only reported); refused : whether it must be refused;
    first : the number that the reference model's pictures give to frame 0 of a video, None for pictures; focal : of the
    video's own lens over the longer side, where the reference's pictures were freed of its distortion.
    """

    place: str
    source: str = "images"
    chosen_on: bool = False
    refused: bool = False
    first: int | None = None
    focal: float | None = None

    @property
    def name(self) -> str:
        """Its folder, and the file where a folder has several sources."""
        stem = Path(self.source).stem
        return Path(self.place).name + ("" if stem == "images" else f"_{stem}")


#: Cheapest first.
SETS = (
    FootageSet("captures/box_desk", chosen_on=True),
    FootageSet("captures/seoul_bull"),
    FootageSet("captures/banana_lowtex", chosen_on=True),
    FootageSet("captures/seattle_backyard"),
    FootageSet("scenes/tum_office"),
    FootageSet("captures/hexgp_building", chosen_on=True),
    FootageSet("scenes/lund_street", chosen_on=True),
    FootageSet("scenes/carnd_highway", "video.mp4"),
    FootageSet("scenes/walk_carpark", "video.mp4", chosen_on=True, first=1, focal=374.94 / 848),
    FootageSet("scenes/gopro_karma_coast", "video.mp4"),
    FootageSet("scenes/red_kitchen"),
    FootageSet("captures/skull_flash", refused=True),
    FootageSet("scenes/carnd_highway", "video2_solidWhiteRight.mp4"),
    FootageSet("captures/snow_walk"),
    FootageSet("scenes/walk_carpark"),
)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, metavar="DATA")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--sets", nargs="+", default=[row.name for row in SETS], metavar="NAME")
    parser.add_argument("--limit-s", type=float, default=1800, help="seconds for one set (default: %(default)s)")
    parser.add_argument("--before", type=Path, metavar="DIR", help="results of another version")
    parser.add_argument("--write", action="store_true", help=f"write the tables of {PAGE} from the results")
    parser.add_argument("--against", choices=["pycolmap"], help="run plain pycolmap on the same frames, too")
    parser.add_argument("--planted", action="store_true", help="a wrong piece in every model that --out holds")
    parser.add_argument("--sensors", action="store_true", help="the inertial unit and GPS of walk_carpark alone")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    chosen = sorted((row for row in SETS if row.name in options.sets), key=lambda row: options.sets.index(row.name))
    if options.one:
        print(json.dumps(_reconstruct(options.data, chosen[0], options.out)))
        return
    if options.sensors:
        write_between(PAGE, "sensors", _sensors(options.data / "scenes" / "walk_carpark"))
        return
    if options.planted:
        write_between(PAGE, "planted", _planted(options.out))
        return
    for row in chosen:
        if not options.write or not (options.out / f"{row.name}.json").is_file():
            _run(options.data, row, options.out, options.limit_s)
            if options.against is not None:
                _run_plain(options.data, row, options.out, options.limit_s)
    if options.write and options.against is not None:
        write_between(AGAINST_PAGE, "against pycolmap", _against_table(options.out))
    elif options.write:
        write_between(PAGE, "sets", _table(options.out, options.before))


def path_error(centres: FloatArray, reference: FloatArray) -> float:
    """Root mean square distance between two paths (n, 3) after alignment, as a share of the reference's extent.

    The extent is the root mean square distance from its middle.
    """
    from capture.mapping.model_metrics import aligned_distance

    return aligned_distance(centres, reference)


def _run(data: Path, row: FootageSet, out: Path, limit_s: float) -> None:
    """Reconstruct one set in a process of its own and keep what came of it."""
    words = ["-m", "benchmarks.estimator.real_footage", str(data), "--out", str(out), "--one", "--sets", row.name]
    run = run_child([sys.executable, *words], limit_s, {"OMP_NUM_THREADS": "1"})
    (out / f"{row.name}.log").write_text(run.errors, encoding="utf-8")
    lines = run.output.splitlines()
    if run.timed_out:
        result = {"failure": f"no answer in {limit_s:.0f} s"}
    else:
        result = json.loads(lines[-1]) if run.status == 0 and lines else {"failure": f"ended with {run.status}"}
    (out / f"{row.name}.json").write_text(json.dumps(result) + "\n", encoding="utf-8")
    print(row.name, json.dumps(result), flush=True)


def _run_plain(data: Path, row: FootageSet, out: Path, limit_s: float) -> None:
    """Run plain pycolmap on the images, or on the frames that ours chose of a video, and keep its result."""
    place, scratch = data / row.place, out / f"{row.name}.plain"
    shutil.rmtree(scratch, ignore_errors=True)
    images = place / row.source if (place / row.source).is_dir() else out / row.name / "frames"
    run = run_child([sys.executable, "-m", "benchmarks.estimator.plain_colmap", str(images), str(scratch)], limit_s)
    lines = run.output.splitlines()
    result = json.loads(lines[-1]) if run.status == 0 and lines else {"placed": 0, "focal": None}
    result |= {"wall_s": round(run.wall_s, 1), "cpu_s": round(run.cpu_s, 1)}
    if (scratch / "sparse" / "images.bin").is_file():
        result |= _against_reference(place, row, scratch / "sparse")
    (out / f"{row.name}.plain.json").write_text(json.dumps(result) + "\n", encoding="utf-8")
    print(row.name, "plain", json.dumps(result), flush=True)


def _against_table(out: Path) -> str:
    """Rows of placed frames, path, focal length, wall and processor seconds, ours and of plain pycolmap."""
    head = [
        "set",
        "placed",
        "path",
        "focal",
        "wall, s",
        "CPU, s",
        "plain: placed",
        "path",
        "focal",
        "wall, s",
        "CPU, s",
    ]
    lines = ["| " + " | ".join([*head, "reference focal"]) + " |", "|---" * (len(head) + 1) + "|"]
    for row in SETS:
        result, file = _result(out, row), out / f"{row.name}.plain.json"
        if not result or not file.is_file():
            continue
        plain = json.loads(file.read_text(encoding="utf-8"))
        failure = result["failure"]
        if failure is None:
            cells = [
                f"{len(result['model']['names'])} of {result['frames']}",
                _path(result),
                f"{result['model']['focal']:.3f}",
            ]
        else:
            cells = [failure if isinstance(failure, str) else f"`{failure['code']}`", "", ""]
        cells += [f"{result.get('wall_s', 0):.0f}", f"{result.get('cpu_s', 0):.0f}", str(plain["placed"]), _path(plain)]
        cells += [
            "" if plain["focal"] is None else f"{plain['focal']:.3f}",
            f"{plain['wall_s']:.0f}",
            f"{plain['cpu_s']:.0f}",
        ]
        reference = result.get("reference_focal", plain.get("reference_focal"))
        lines.append("| " + " | ".join([f"`{row.name}`", *cells, f"{reference:.3f}" if reference else ""]) + " |")
    return "\n".join(lines)


def _path(result: dict[str, Any]) -> str:
    return f"{100 * result['path_error']:.1f} %" if "path_error" in result else ""


def _reconstruct(data: Path, row: FootageSet, out: Path) -> dict[str, Any]:
    from capture.mapping.refusals import CaptureFailure
    from capture.pipeline import CaptureOptions, reconstruct
    from capture.work_folder import WorkFolder

    place = data / row.place
    folder = out / row.name
    shutil.rmtree(folder, ignore_errors=True)
    work = WorkFolder(folder)
    started, cpu = time.perf_counter(), sum(os.times()[:4])
    failure = None
    with work.lock():
        try:
            reconstruct(place / row.source, work, CaptureOptions())
        except CaptureFailure as refusal:
            failure = {"code": refusal.failure.code, "message": refusal.failure.message}
    report = json.loads((folder / "reconstruction.json").read_text(encoding="utf-8"))
    return {
        "failure": failure,
        "frames": report["pairs"]["frames"],
        "strategy": report["strategy"],
        "tried": report["tried"],
        "model": report["model"],
        "pairs": report["pairs"],
        "disagreement": report["disagreement"],
        "cpu_s": round(sum(os.times()[:4]) - cpu, 1),
        "wall_s": round(time.perf_counter() - started, 1),
        **(_against_reference(place, row, folder / "sparse" / "0") if failure is None else {}),
    }


def _against_reference(place: Path, row: FootageSet, model: Path) -> dict[str, Any]:
    """Camera model and path of what was reconstructed, and how far they are from the reference's, if there is one."""
    from estimator.reconstructions.colmap import read_colmap

    scene = read_colmap(model)
    camera = scene.views[0].camera
    result: dict[str, Any] = {
        "camera": [camera.model, camera.width, camera.height, np.round(camera.params, 4).tolist()]
    }
    if not (place / "sparse").is_dir():
        return result
    from estimator.reconstructions.pycolmap_library import pycolmap

    reference = pycolmap.Reconstruction(place / "sparse" / "0")  # of some sets the cameras alone are given
    known = {image.name: image.projection_center() for image in reference.images.values() if image.has_pose}
    pairs = [(view.centre, known[name]) for view in scene.views if (name := _reference_name(view.name, row)) in known]
    theirs = next(iter(reference.cameras.values()))
    result |= {
        "reference_focal": row.focal or float(theirs.params[0]) / max(theirs.width, theirs.height),
        "reference_views": len(known),
        "shared": len(pairs),
    }
    if len(pairs) > 2:
        result["path_error"] = path_error(*(np.array(centres) for centres in zip(*pairs, strict=True)))
    return result


def _reference_name(name: str, row: FootageSet) -> str:
    if row.first is None:
        return name
    return f"{int(Path(name).stem) + row.first:04d}.jpg"


def _cell(result: dict[str, Any]) -> list[str]:
    """Placed, focal length, residual, path, seconds of one result."""
    if not result:
        return ["not run", "", "", "", ""]
    failure = result["failure"]
    if failure is not None:
        code = failure if isinstance(failure, str) else f"`{failure['code']}`"
        return [code, "", "", "", f"{result.get('cpu_s', 0):.0f}"]
    model = result["model"]
    focal = f"{model['focal']:.3f}"
    if "reference_focal" in result:
        focal += f" ({result['reference_focal']:.3f})"
    path = f"{100 * result['path_error']:.1f} %" if "path_error" in result else ""
    return [
        f"{len(model['names'])} of {result['frames']}",
        focal,
        f"{model['error_px']:.2f}",
        path,
        f"{result['cpu_s']:.0f}",
    ]


def _table(out: Path, before: Path | None) -> str:
    head = ["set", "", "placed", "focal length (reference)", "residual, px", "path", "s", "strategy"]
    if before is not None:
        head += ["before", "path", "s"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in SETS:
        result, earlier = _result(out, row), {} if before is None else _result(before, row)
        use = "must be refused" if row.refused else "chosen on" if row.chosen_on else "reported"
        cells = [f"`{row.name}`", use, *_cell(result), str(result.get("strategy") or "")]
        if before is not None:
            placed, focal, _, path, seconds = _cell(earlier)
            cells += [placed + (f", f {focal}" if focal else ""), path, seconds]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def sensor_rows(place: Path) -> list[tuple[str, ScaleEvidence]]:
    """What inertial unit and GPS of a video say of the reference model, by the whole path and its halves.

    place : a set with `video.mp4`, whose reference model has pictures named by the video's frames, from 1.
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


def _planted(out: Path) -> str:
    """Rows of the models as they are, and with their last third as a wrong piece."""
    from capture.mapping.features import STRATEGIES

    suffixes = {row.name: row.suffix for row in STRATEGIES}
    head = ["set", "frames", "triplets", "largest residual, px", "largest stretch", "contradicted", "pieces"]
    head += [*PLANTS, *LONGER]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in SETS:
        result = _result(out, row)
        if result and result["failure"] is None:
            database = out / row.name / "databases" / f"matches{suffixes[result['strategy']]}.db"
            with tempfile.TemporaryDirectory() as scratch:  # to open a database changes it
                copied = shutil.copy(database, scratch)
                lines.append(f"| `{row.name}` | " + " | ".join(_planted_cells(out / row.name, str(copied))) + " |")
    return "\n".join(lines)


def _planted_cells(folder: Path, database: str) -> list[str]:
    from scipy.spatial.transform import Rotation

    from capture.mapping.triplets import agreement, model_triplets
    from estimator.reconstructions.pycolmap_library import pycolmap
    from tests.synthetic.wrong_pieces import lengthen_steps, move_frames

    model = pycolmap.Reconstruction(folder / "sparse" / "0")
    triplets = model_triplets(model, database)
    agreed = agreement(triplets, model.num_reg_images())
    worst, stretch = max(row.residual_px for row in triplets), max(abs(row.stretch) for row in triplets)
    cells = [str(agreed.frames), str(agreed.triplets), f"{worst:.1f}", f"{stretch:.2f}", str(agreed.contradicted)]
    cells.append(", ".join(str(len(piece)) for piece in agreed.parts))
    names = sorted(image.name for image in model.images.values() if image.has_pose)
    wrong = set(names[len(names) - len(names) // 3 :])
    for turn_deg, shift, factor in PLANTS.values():
        planted = pycolmap.Reconstruction(folder / "sparse" / "0")
        move_frames(planted, wrong, Rotation.from_euler("y", turn_deg, degrees=True).as_matrix(), shift, factor)
        found = agreement(model_triplets(planted, database), len(names))
        kept = set(found.parts[0]) if found.parts else set()
        mixed = min(len(kept & wrong), len(kept - wrong))
        cells.append(f"{_refused(found)}{len(kept)} kept, {mixed} mixed")
    middle = set(names[len(names) * 5 // 12 : len(names) * 7 // 12])
    for factor in LONGER.values():
        planted = pycolmap.Reconstruction(folder / "sparse" / "0")
        lengthen_steps(planted, middle, factor)
        found = agreement(model_triplets(planted, database), len(names))
        cells.append(f"{_refused(found)}{len(found.parts[0]) if found.parts else 0} kept")
    return cells


def _refused(found: TripletAgreement) -> str:
    ratio = found.contradicted / max(found.triplets, 1)
    wrong = ratio > MAX_CONTRADICTED_RATIO or len(found.broken) >= MIN_BROKEN_FRAMES
    return "refused, " if wrong else ""


def _result(folder: Path, row: FootageSet) -> dict[str, Any]:
    file = folder / f"{row.name}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}


if __name__ == "__main__":
    main()
