"""The objects drawn by Cycles for every picture, and `.blend` files."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from insertion.blender.job import ideal_window, insertion_job
from insertion.blender.process import VARIABLE, blender_program, run_blender
from insertion.exports.metric_frame import camera_keys, frame_rate, metric_frame
from insertion.footage.footage import Shot
from insertion.insertion_scene import PreparedScene
from insertion.light.environment_estimate import environment_at
from insertion.light.environment_map import Environment
from insertion.placement.placed_object import Placed
from insertion.render.layers import through_lens
from insertion.scene.pixel_box import PixelBox
from metric_base.errors import InputError
from metric_base.progress import ProgressCallback, silent

__all__ = ["export_blend", "traced_layers", "write_blend"]

Layer = NDArray[np.float32]


@contextmanager
def traced_layers(
    prepared: PreparedScene, objects: Sequence[Placed], environment: Environment, progress: ProgressCallback = silent
) -> Iterator[Callable[[Shot], Layer]]:
    """A function from a shot to its (h, w, 4) layer through the lens; all are rendered first, in one run."""
    frame = metric_frame(objects, prepared.scale.metres_per_unit)
    shots = [shot for shot in prepared.footage.shots if shot.view is not None]
    with tempfile.TemporaryDirectory(prefix="insert-object-") as name:
        folder = Path(name)
        job = insertion_job(objects, camera_keys(shots, frame), frame, environment, folder)
        run_blender(job | {"out": str(folder)}, folder, progress)
        stems = {shot.index: f"{number:06d}" for number, shot in enumerate(shots)}

        def layer(shot: Shot) -> Layer:
            assert shot.view is not None  # only shots with a pose are drawn on
            ideal = np.load(folder / f"{stems[shot.index]}.npy", allow_pickle=False).astype(np.float32)
            camera = shot.view.camera
            return through_lens(ideal, shot.view, PixelBox(0, 0, camera.width, camera.height))

        yield layer


def export_blend(folder: Path, prepared: PreparedScene, objects: Sequence[Placed]) -> list[str]:
    """`scene.blend` in the folder if there is a Blender; what could not be written, one line each."""
    try:
        blender_program()
    except InputError:
        return [f"scene.blend is not written: there is no Blender (on PATH, or named by {VARIABLE})"]
    first = objects[0]
    height = float(first.model.extents[1]) * first.size.factor / prepared.scale.metres_per_unit
    environment = environment_at(first.place, height, prepared.cloud, prepared.stills, prepared.shading())
    write_blend(folder / "scene.blend", prepared, objects, environment)
    return []


def write_blend(file: Path, prepared: PreparedScene, objects: Sequence[Placed], environment: Environment) -> None:
    """The scene with its animated camera as a `.blend` file, which packs what it needs."""
    frame = metric_frame(objects, prepared.scale.metres_per_unit)
    shots = prepared.footage.shots
    with tempfile.TemporaryDirectory(prefix="insert-object-") as name:
        folder = Path(name)
        job = insertion_job(objects, camera_keys(shots, frame), frame, environment, folder, ideal_window)
        run_blender(job | {"blend": str(file.resolve()), "rate": frame_rate(shots)}, folder)
