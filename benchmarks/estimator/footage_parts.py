"""Parts of real sets through the capture: `python -m benchmarks.estimator.footage_parts DATA --out DIR [--write]`.

A set is one case; its parts are several, and harder ones: fewer pictures, a shorter path, less detail. Of every set of
pictures with a reference model: the first, second and middle half, every second picture and the others, and all of them
shrunk to 640 pixels without their EXIF; of long walks six windows of thirty. What comes through is right if its path is
within 3 % of the reference's. A refusal is wrong if pycolmap alone, with the reference's camera given, places nine in
ten of the pictures that rightly. `--write` makes the table of docs/evidence/real_footage.md.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.child import run_child
from benchmarks.common import write_between
from benchmarks.estimator.real_footage import PAGE, path_error

#: Largest error of a right path, as a share of its extent, and least share of the pictures that a model places.
RIGHT_PATH, LEAST_PLACED = 0.03, 0.9
#: Longer side of shrunk pictures; pictures of a window, and windows; a set is cut into them from so many pictures.
SHRUNK_PX, WINDOW, WINDOWS, LONG = 640, 30, 6, 100
LIMIT_S = 1800.0


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, metavar="DATA")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="results, which a later run continues")
    parser.add_argument("--write", action="store_true", help="write the table of the page from the results")
    parser.add_argument("--one", metavar="PART", help=argparse.SUPPRESS)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for place, part, names in _parts(options.data):
        key = f"{place.name}, {part}"
        if options.one == key:
            print(json.dumps(_result(place, names, part.startswith("shrunk"), options.out / "work" / key)))
        file = options.out / f"{key}.json"
        if options.one is None and not options.write and not file.exists():
            words = ["-m", "benchmarks.estimator.footage_parts", str(options.data), "--out", str(options.out)]
            run = run_child([sys.executable, *words, "--one", key], LIMIT_S, {"OMP_NUM_THREADS": "1"})
            lines = run.output.splitlines()
            result = json.loads(lines[-1]) if run.status == 0 and lines else {"code": "no answer", "wrong": True}
            file.write_text(json.dumps(result) + "\n", encoding="utf-8")
            print(key, json.dumps(result), flush=True)
    if options.write:
        write_between(PAGE, "parts", _table(options.out))


def _parts(data: Path) -> Iterator[tuple[Path, str, list[str]]]:
    """Set, name and pictures of every part."""
    for place in sorted([*(data / "captures").iterdir(), *(data / "scenes").iterdir()]):
        if not (place / "images").is_dir() or not (place / "sparse").is_dir():
            continue
        names = sorted(path.name for path in (place / "images").iterdir())
        half = (len(names) + 1) // 2
        if len(names) >= LONG:
            for start in (sixth * len(names) // WINDOWS for sixth in range(WINDOWS)):
                yield place, f"{WINDOW} from {start}", names[start : start + WINDOW]
            continue
        yield place, "first half", names[:half]
        yield place, "second half", names[half:]
        yield place, "middle half", names[half // 2 : half // 2 + half]
        yield place, "every second", names[::2]
        yield place, "the others", names[1::2]
        yield place, f"shrunk to {SHRUNK_PX} px", names


def _result(place: Path, names: list[str], shrink: bool, folder: Path) -> dict[str, Any]:
    """What came of one part: placed, path error, strategy; or the refusal, and whether it is wrong."""
    from capture.mapping.refusals import CaptureFailure
    from capture.pipeline import CaptureOptions, reconstruct
    from capture.work_folder import WorkFolder

    pictures = folder / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    for name in names:
        _write_picture(place / "images" / name, pictures / name, shrink)
    work = WorkFolder(folder / "capture")
    with work.lock():
        try:
            reconstruct(pictures, work, CaptureOptions())
        except CaptureFailure as refusal:
            alone = _alone(place, pictures, folder)
            wrong = alone["placed"] >= LEAST_PLACED * len(names) and alone["path"] < RIGHT_PATH
            return {"pictures": len(names), "code": refusal.failure.code, "alone": alone, "wrong": wrong}
    report = json.loads((folder / "capture" / "reconstruction.json").read_text(encoding="utf-8"))
    return {
        "pictures": len(names),
        "strategy": report["strategy"],
        **_compared(place, folder / "capture" / "sparse" / "0"),
    }


def _write_picture(source: Path, target: Path, shrink: bool) -> None:
    target.unlink(missing_ok=True)
    if not shrink:
        target.symlink_to(source.resolve())
        return
    picture = cv2.imread(str(source))
    assert picture is not None
    factor = min(1.0, SHRUNK_PX / max(picture.shape[:2]))
    cv2.imwrite(str(target), cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA))


def _compared(place: Path, model: Path) -> dict[str, Any]:
    """How many pictures a model places, and how far its path is from the reference's."""
    from estimator.reconstructions.pycolmap_library import pycolmap

    def centres(folder: Path) -> dict[str, Any]:
        images = pycolmap.Reconstruction(folder).images.values()
        return {image.name: image.projection_center() for image in images if image.has_pose}

    own, reference = centres(model), centres(place / "sparse" / "0")
    shared = sorted(own.keys() & reference.keys())
    if len(shared) < 3:
        return {"placed": len(own), "path": float("nan")}
    error = path_error(np.array([own[name] for name in shared]), np.array([reference[name] for name in shared]))
    return {"placed": len(own), "path": round(error, 4)}


def _alone(place: Path, pictures: Path, folder: Path) -> dict[str, Any]:
    """The same of pycolmap's defaults with the camera of the reference model."""
    from estimator.reconstructions.pycolmap_library import pycolmap

    camera = next(iter(pycolmap.Reconstruction(place / "sparse" / "0").cameras.values()))
    picture = cv2.imread(str(next(pictures.iterdir())))
    assert picture is not None
    camera.rescale(picture.shape[1], picture.shape[0])
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model, reader.camera_params = camera.model.name, ",".join(map(str, camera.params))
    database, out = folder / "alone.db", folder / "alone"
    out.mkdir()
    pycolmap.extract_features(database, pictures, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader)
    pycolmap.match_exhaustive(database)
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    models = pycolmap.incremental_mapping(database, pictures, out, options)
    if not models:
        return {"placed": 0, "path": float("nan")}
    largest = max(models, key=lambda key: models[key].num_reg_images())
    return _compared(place, out / str(largest))


def _outcome(result: dict[str, Any]) -> str:
    if "path" not in result:
        return "refused, wrongly" if result["wrong"] else "refused"
    return "right" if result["path"] < RIGHT_PATH else "wrong"


def _table(out: Path) -> str:
    lines = ["| part | outcome | placed | path | strategy, or refusal |", "|---|---|---|---|---|"]
    counts: Counter[str] = Counter()
    for file in sorted(out.glob("*.json")):
        result = json.loads(file.read_text(encoding="utf-8"))
        counts[outcome := _outcome(result)] += 1
        placed = f"{result.get('placed', 0)} of {result['pictures']}" if "pictures" in result else ""
        path = f"{result['path']:.1%}" if "path" in result else ""
        lines.append(
            f"| {file.stem} | {outcome} | {placed} | {path} | {result.get('strategy') or result.get('code', '')} |"
        )
    total = ", ".join(f"{count} {outcome}" for outcome, count in counts.most_common())
    return "\n".join([*lines, f"| **all {counts.total()}** | **{total}** | | | |"])


if __name__ == "__main__":
    main()
