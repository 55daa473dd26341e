"""The ten cases of docs/evidence/cases.md: where each video comes from, and what is put into it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.synthetic.rooms.cameras import drive
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.street import STEP, street
from tests.synthetic.rooms.world import World
from tests.synthetic.videos import Lens, room, synthetic_video

__all__ = ["CASES", "SHARED", "Case", "video_of", "world_of"]

ROOT = Path(__file__).resolve().parents[3]
#: Real scenes and open models, beside the repository or above it.
SHARED = next(
    (place for parent in ROOT.parents if (place := parent / "shared" / "data").is_dir()), ROOT.parent / "shared"
)
SHIPPED = ROOT / "data" / "models" / "rocking_horse.glb"
CC0 = "sweethome3d/BlendSwap-CC-0/"
#: Frames of a synthetic video and frames a second; a car at 40 km/h goes half a metre between frames.
FRAMES, RATE, METRES_A_FRAME = 48, 20.0, 0.55


@dataclass(frozen=True, slots=True)
class Case:
    """One video and one object.

    name : of the row; video : `KIND:SEED` of a test world, `demo_video`, or a scene below SHARED; model : below the
    models of SHARED, or None for the shipped one; words : more arguments of insert-object; frames : to reconstruct.
    """

    name: str
    video: str
    model: str | None = None
    words: tuple[str, ...] = ()
    frames: int = 16

    @property
    def model_file(self) -> Path:
        """The model, or the shipped one where there is no shared data."""
        file = SHIPPED if self.model is None else SHARED / "models" / self.model
        return file if file.is_file() else SHIPPED

    @property
    def real(self) -> bool:
        """Whether the video is a real scene, of which no picture may be published."""
        return ":" not in self.video and self.video != "demo_video"

    @property
    def folder_name(self) -> str:
        """The name for a folder."""
        return self.name.replace(",", "").replace(" ", "-")


#: No seed below had been used for anything when this list was written.
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


def world_of(case: Case) -> World:
    """The synthetic world of a video, with its path."""
    if case.video == "demo_video":
        return room("sitting room", 7, frames=60)
    kind, seed = case.video.rsplit(":", 1)
    if kind != "street":
        return room(kind, int(seed), frames=FRAMES)
    world = street(int(seed), Knobs())
    path = drive(METRES_A_FRAME, Knobs(views=FRAMES), np.random.default_rng([int(seed), 7]))
    slower = METRES_A_FRAME / STEP  # objects move by metres a frame
    items = tuple(replace(item, velocity=item.velocity * slower) for item in world.objects)
    return replace(world, objects=items, poses=path)


def video_of(case: Case, folder: Path) -> Path:
    """The folder with `video.mp4`, `instances.json` and `truth.json` of a synthetic video; recorded if missing."""
    if case.video == "demo_video":
        return ROOT / "data" / "scenes" / "demo_video"
    if not (folder / "truth.json").is_file():
        synthetic_video(world_of(case), Lens(), folder, RATE)
    return folder
