"""Run both commands on ten cases: `python -m benchmarks.insertion.cases --out DIR [--case NAME ...]`.

Videos of synthetic rooms and streets are rendered; for the real scenes, in a folder next to the repository, the
reconstruction is given. `estimate-scale` and `insert-object` run as a user runs them. Prints the error of the scale and
its interval, the number of frames with the object, and the processor seconds of both commands. Videos and images are
stored in DIR.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.child import ours, run_child
from benchmarks.common import ROOT, SHARED, options_parser, print_rows
from estimator.reconstructions.scene_reader import read_scene
from tests.synthetic.rooms.cameras import drive
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.similarity import similarity_between
from tests.synthetic.rooms.street import STEP, street
from tests.synthetic.rooms.world import World
from tests.synthetic.videos import Lens, room, synthetic_video

SHIPPED = ROOT / "data" / "models" / "rocking_horse.glb"
CC0 = "sweethome3d/BlendSwap-CC-0/"
#: Number of frames of a synthetic video, and frames per second.
N_FRAMES = 48
RATE_HZ = 20.0
#: Distance between frames of a street video in metres: 40 km/h at 20 frames per second.
METRES_PER_FRAME = 0.55
#: Time limit of a command in seconds.
LIMIT_S = 900


@dataclass(frozen=True, slots=True)
class Case:
    """A video and an object.

    video : `KIND:SEED` of a synthetic world, `demo_video`, or a scene of SHARED.
    model : path in the models of SHARED; None: the shipped model.
    arguments : additional arguments of `insert-object`.
    frames : number of frames of the reconstruction.
    """

    name: str
    video: str
    model: str | None = None
    arguments: tuple[str, ...] = ()
    frames: int = 16


#: None of these seeds had been used before this list was written.
CASES = (
    Case("sitting room", "sitting room:2001", CC0 + "oakChair.glb"),
    Case("kitchen", "kitchen:2002", CC0 + "dustbin.glb"),
    Case("toilet", "toilet:2003", CC0 + "toiletBrush.glb"),
    Case("bedroom", "bedroom:2004", CC0 + "basketball.glb"),
    Case("study", "study:2005", CC0 + "stool.glb"),
    Case("street, car", "street:2006", "gazebo/hatchback_red.glb", ("--facing", "90"), frames=32),
    Case("street, bench", "street:2007", CC0 + "bench.glb", frames=32),
    Case("demo_video", "demo_video"),
    Case("tum_office", "tum_office", CC0 + "yogurtBottle.glb"),
    Case("red_kitchen", "red_kitchen", CC0 + "tetrapak.glb"),
)


def main() -> None:
    """Run the cases and print the table."""
    parser = options_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--case", nargs="+", default=[], choices=[case.name for case in CASES], metavar="NAME")
    options = parser.parse_args()
    chosen = [case for case in CASES if not options.case or case.name in options.case]
    columns = ("case", "object", "views", "scale", "its 90 % interval", "frames with it", "CPU s: scale", "insertion")
    print_rows(columns, (_cells(case, options.out / case.name.replace(",", "").replace(" ", "-")) for case in chosen))


def _cells(case: Case, folder: Path) -> Iterator[object]:
    """Yield the cells of a case. The row ends with the error of a command that fails."""
    folder.mkdir(parents=True, exist_ok=True)
    model = SHIPPED if case.model is None else SHARED / "models" / case.model
    yield from (case.name, model.stem)
    is_synthetic = ":" in case.video or case.video == "demo_video"
    video, work = (_video_of(case, folder), folder / "work") if is_synthetic else (None, folder / "result.json")
    scene = SHARED / "scenes" / case.video if video is None else work
    arguments: list[object] = [scene, "--output", work]
    if video is not None:
        masks = video / "instances.json"
        arguments = [video / "video.mp4", "--work", work, "--instances", masks, "--frames", case.frames]
    record, seconds = _result("estimate-scale", arguments)
    if record.get("scale") is None:
        yield record["error"]
        return
    views = read_scene(scene).views
    true = json.loads(((video or scene) / "truth.json").read_text(encoding="utf-8"))
    if video is not None:
        frames = [true["frames"][int(Path(view.name).stem)] for view in views]
        centres = np.array([-np.array(frame["rotation"]).T @ frame["translation"] for frame in frames])
        true["metres_per_unit"] = 1 / similarity_between(centres, np.array([view.centre for view in views])).scale
    scale, low, high = (
        value / true["metres_per_unit"] - 1
        for value in (record["scale"], record["interval"]["low"], record["interval"]["high"])
    )
    inside = "" if low <= 0 <= high else ", **outside**"
    yield from (len(views), f"{scale:+.1%}", f"{low:+.0%} to {high:+.0%}{inside}")
    out = folder / ("out" if video is None else "out.mp4")
    shutil.rmtree(out, ignore_errors=True) if out.is_dir() else out.unlink(missing_ok=True)
    known_scale = ("--scale", record["scale"]) if video is None else ()
    inserted, more = _result("insert-object", [scene, *known_scale, "--model", model, "--out", out, *case.arguments])
    shown = [frame for frame in inserted.get("frames", ()) if frame["silhouette"] is not None]
    yield from (inserted.get("error", len(shown)), f"{seconds:.0f}", f"{more:.0f}")


def _result(program: str, arguments: list[object]) -> tuple[dict[str, Any], float]:
    """Run a command; return its printed record (with `error` if it fails) and its processor seconds."""
    run = run_child(ours(program, *arguments, "--json"), LIMIT_S)
    record: dict[str, Any] = json.loads(run.output) if run.output.strip() else {}
    if run.status:
        failure = record.get("failure")
        record["error"] = f"`{failure['code']}`" if failure else run.errors.strip() or str(record.get("status"))
    return record, run.cpu_s


def _video_of(case: Case, folder: Path) -> Path:
    """Return the folder with `video.mp4`, `instances.json` and `truth.json`; render the video if it is missing."""
    if case.video == "demo_video":
        return ROOT / "data" / "scenes" / "demo_video"
    if not (folder / "truth.json").is_file():
        synthetic_video(_world_of(*case.video.rsplit(":", 1)), Lens(), folder, RATE_HZ)
    return folder


def _world_of(kind: str, seed: str) -> World:
    """Return the synthetic world of a video with its camera path."""
    if kind != "street":
        return room(kind, int(seed), frames=N_FRAMES)
    world = street(int(seed), Knobs())
    path = drive(METRES_PER_FRAME, Knobs(views=N_FRAMES), np.random.default_rng([int(seed), 7]))
    slower = METRES_PER_FRAME / STEP  # velocities are in metres per frame
    items = tuple(replace(item, velocity=item.velocity * slower) for item in world.objects)
    return replace(world, objects=items, poses=path)


if __name__ == "__main__":
    main()
