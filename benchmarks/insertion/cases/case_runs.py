"""One case from the video to the picture, through the commands themselves, with CPU seconds and errors."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.child import ours, run_child
from benchmarks.insertion.cases.case_list import SHARED, Case, video_of, world_of
from estimator.reading import read_scene
from insertion.models.model import Model
from insertion.pipeline.objects import Placed, place_objects
from metric_base.arrays import BoolArray
from metric_cli.insert_object.insert import parser
from metric_cli.insert_object.scene_arguments import prepared_scene_of, requests_of
from tests.synthetic.insertions import RecordedRoom, added
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.similarity import Similarity
from tests.synthetic.rooms.solids import Mesh
from tests.synthetic.rooms.world import World

__all__ = ["Outcome", "drawn_heights", "run_case"]

#: The room a command has before it is stopped, seconds.
LIMIT = 900
#: An outline of fewer rows says little: a row is then more than 5 %.
LEAST_ROWS = 20
#: True outlines are rendered for so many frames.
LOOKED_AT = 16


@dataclass(frozen=True, slots=True)
class Outcome:
    """A row of the table. Errors are shares; `inside` says whether the interval contains the true scale.

    seconds : CPU of the stages by name; frames : of the video and those reconstructed; heights : frames that the size
    error rests on; refusal : the message of a case that was refused.
    """

    frames: tuple[int, int]
    seconds: dict[str, float]
    scale: float | None = None
    interval: tuple[float, float] | None = None
    size: float | None = None
    heights: int = 0
    refusal: str | None = None

    @property
    def inside(self) -> bool:
        """Whether the interval contains the truth."""
        return self.interval is not None and self.interval[0] <= 0 <= self.interval[1]


def run_case(case: Case, folder: Path) -> Outcome:
    """Estimate the scale, insert the object, compare. The output is `out.mp4`, or `out/` of a real scene."""
    if case.real:
        return _run_real(case, folder)
    video, work = video_of(case, folder), folder / "work"
    words = [video / "video.mp4", "--work", work, "--instances", video / "instances.json", "--frames", case.frames]
    started = time.time()
    code, record, estimate = _command("estimate-scale", [*words, "--json"])
    length = len(json.loads((video / "truth.json").read_text(encoding="utf-8"))["frames"])
    seconds = _stages(work, estimate, started)
    if code:
        return Outcome((length, 0), seconds, refusal=_refusal(record))
    to_scene = _work_similarity(video, work)
    true = 1 / to_scene.scale
    scale, interval = _scale_errors(record, true)
    chosen = len(read_scene(work).views)
    words = [work, "--model", case.model_file, "--out", _fresh(folder / "out.mp4"), *case.words]
    code, inserted, seconds["insertion"] = _command("insert-object", [*words, "--json"])
    if code:
        return Outcome((length, chosen), seconds, scale, interval, refusal=_refusal(inserted))
    _keep(folder, inserted)
    placed = _placed_object(words)
    world = world_of(case)
    masks = _true_heights(world, work, to_scene, placed, drawn_heights(inserted))
    size, heights = _ratio_of(drawn_heights(inserted), masks)
    return Outcome((length, chosen), seconds, scale, interval, size, heights)


def _run_real(case: Case, folder: Path) -> Outcome:
    """A scene with its reconstruction given; its drawn height is compared with that at the true scale."""
    scene = SHARED / "scenes" / case.video
    true = json.loads((scene / "truth.json").read_text(encoding="utf-8"))["metres_per_unit"]
    folder.mkdir(parents=True, exist_ok=True)
    code, record, seconds = _command("estimate-scale", [scene, "--json", "--output", folder / "result.json"])
    views = len(read_scene(scene).views)
    if code:
        return Outcome((views, views), {"scale": seconds}, refusal=_refusal(record))
    scale, interval = _scale_errors(record, true)
    records, spent = [], {"scale": seconds}
    for name, used in (("out", record["scale"]), ("out_true", true)):
        words = [scene, "--scale", used, "--model", case.model_file, "--out", _fresh(folder / name), *case.words]
        code, inserted, seconds = _command("insert-object", [*words, "--json"])
        if code:
            return Outcome((views, views), spent, scale, interval, refusal=_refusal(inserted))
        spent.setdefault("insertion", seconds)
        records.append(inserted)
    _keep(folder, records[0])
    size, heights = _ratio_of(*(drawn_heights(inserted) for inserted in records))
    return Outcome((views, views), spent, scale, interval, size, heights)


def _command(program: str, words: list[Any]) -> tuple[int, dict[str, Any], float]:
    """Exit status, the printed record (or the error), and CPU seconds of a command with all its processes."""
    run = run_child(ours(program, *words), LIMIT)
    record: dict[str, Any] = json.loads(run.output) if run.output.strip() else {"error": run.errors.strip()}
    return run.status, record, run.cpu_s


def _work_similarity(video: Path, work: Path) -> Similarity:
    """From true metres to the reconstruction of a work folder: its cameras' directions, then their centres.

    The centres of a straight drive alone would leave the turn about its line open.
    """
    truth = json.loads((video / "truth.json").read_text(encoding="utf-8"))["frames"]
    views = read_scene(work).views
    rows = [truth[int(Path(view.name).stem)] for view in views]
    true = [np.array(row["rotation"]) for row in rows]
    total = np.sum([view.rotation.T @ rotation for view, rotation in zip(views, true, strict=True)], axis=0)
    left, _, right = np.linalg.svd(total)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    before = np.array([-rotation.T @ row["translation"] for rotation, row in zip(true, rows, strict=True)])
    after = np.array([view.centre for view in views])
    around, moved = (before - before.mean(axis=0)) @ turn.T, after - after.mean(axis=0)
    scale = float((around * moved).sum() / (around**2).sum())
    return Similarity(scale, turn, after.mean(axis=0) - scale * turn @ before.mean(axis=0))


def _mesh_of(model: Model, factor: float = 1.0) -> Mesh:
    """A model (y up, front +z) as a made solid (z up, front -y) in metres, standing on the origin."""
    parts = [(part.vertices, part.faces) for part in model.parts]
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    faces = np.concatenate([faces + first for (_, faces), first in zip(parts, starts, strict=False)])
    low, high = model.bounds
    foot = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    local = (vertices - foot)[:, [0, 2, 1]] * [1, -1, 1] * factor
    return Mesh(local, faces, ("wood",) * len(faces))


def drawn_heights(inserted: dict[str, Any]) -> dict[int, int]:
    """Rows of the object's own outline in each frame that shows all of it, by the frame's number."""
    heights = {}
    for number, frame in enumerate(inserted["frames"]):
        if (box := frame["silhouette"]) is not None and box["height"] >= LEAST_ROWS and box["x"] > 1 and box["y"] > 1:
            heights[number] = int(box["height"])
    return heights


def _true_heights(
    world: World, work: Path, to_scene: Similarity, placed: Placed, wanted: Mapping[int, float]
) -> dict[int, int]:
    """Rows of the same mesh at its true size at the same place, through the true cameras, where all of it is shown."""
    room = RecordedRoom(world, read_scene(work), (), work, to_scene)
    mesh = _mesh_of(placed.model, placed.size.factor)
    alone = added(room, mesh, placed.place.position, placed.front, alone=True)
    rows = sorted(wanted)[:: max(1, len(wanted) // LOOKED_AT)]
    with Renderer(alone) as renderer:
        masks = {row: renderer.frame(row, colour=False).ids == 1 for row in rows}
    return {row: height for row, mask in masks.items() if (height := _whole_height(mask)) is not None}


def _ratio_of(drawn: Mapping[int, float], true: Mapping[int, float]) -> tuple[float | None, int]:
    """Median of drawn over true heights, less 1, and the number of frames that both have."""
    both = sorted(set(drawn) & set(true))
    return (float(np.median([drawn[k] / true[k] for k in both])) - 1 if both else None), len(both)


def _whole_height(mask: BoolArray) -> int | None:
    """Rows of an outline (h, w) that is wholly in the picture, else None."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows) or rows[0] < 2 or columns[0] < 2:
        return None
    if rows[-1] > mask.shape[0] - 3 or columns[-1] > mask.shape[1] - 3:
        return None
    return int(np.ptp(rows)) + 1


def _placed_object(words: list[Any]) -> Placed:
    """The object as the command placed it."""
    options = parser().parse_args([str(word) for word in words])
    return place_objects(prepared_scene_of(options), requests_of(options))[0]


def _scale_errors(record: dict[str, Any], true: float) -> tuple[float, tuple[float, float]]:
    interval = record["interval"]
    return record["scale"] / true - 1, (interval["low"] / true - 1, interval["high"] / true - 1)


def _stages(work: Path, estimate: float, started: float) -> dict[str, float]:
    """CPU seconds of the stages of a work folder; what its stamps do not name is the estimate itself.

    started : time of day of this run; stages that an earlier run made took none of its seconds.
    """
    files = list((work / "stamps").glob("*.json"))
    stamps = {file.stem: json.loads(file.read_text(encoding="utf-8"))["cpu_seconds"] for file in files}
    now = sum(stamps[file.stem] for file in files if file.stat().st_mtime >= started)
    return stamps | {"scale": max(estimate - now, 0.0)}


def _refusal(record: dict[str, Any]) -> str:
    failure = record.get("failure")
    if failure:
        return f"`{failure['code']}`"
    return str(record.get("error") or "; ".join(record.get("warnings", [])) or record.get("status"))


def _keep(folder: Path, inserted: dict[str, Any]) -> None:
    (folder / "insertion.json").write_text(json.dumps(inserted) + "\n", encoding="utf-8")


def _fresh(path: Path) -> Path:
    """The path with nothing there."""
    shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    return path
