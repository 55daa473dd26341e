"""Where Blender is, and one run of it.

Blender is GPL and wants an exact Python: it never runs in our process. `METRIC_TREE_BLENDER` names a `blender` program
or the Python of an environment that has `bpy`; without it, `blender` on PATH is used.

`--layers DIR`: `DIR/blender/scene.py`, which the user's Blender runs to get `DIR/scene.blend`. Nothing runs here.

The objects drawn by Cycles for every picture, and `.blend` files.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.blender.job import full_window, ideal_window, insertion_job
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
from models3d.gltf.model_writer import write_gltf_model

_SCRIPTS = {"scene.py": "layer_script.py", "script.py": "script.py"}
VARIABLE = "METRIC_TREE_BLENDER"
#: Seconds between two looks at what is done.
POLL_S = 0.2
_SCRIPT = Path(__file__).with_name("script.py")
Layer = NDArray[np.float32]


def write_layer_scene(folder: Path, prepared: PreparedScene, objects: Sequence[Placed]) -> None:
    """Write the script with all that it needs into `folder / "blender"`; pictures without a pose have no camera key."""
    own = folder / "blender"
    own.mkdir()
    for name, source in _SCRIPTS.items():
        shutil.copyfile(Path(__file__).with_name(source), own / name)
    frame = metric_frame(objects, prepared.scale.metres_per_unit)
    posed = [shot for shot in prepared.footage.shots if shot.view is not None]
    first = objects[0]
    height = float(first.model.extents[1]) * first.size.factor / prepared.scale.metres_per_unit
    environment = environment_at(first.place, height, prepared.cloud, prepared.stills, prepared.shading())
    job = insertion_job(objects, camera_keys(posed, frame), frame, environment, own, full_window)
    for number, (item, entry) in enumerate(zip(objects, job["objects"], strict=True), start=1):
        entry["file"] = f"model{number}.glb"
        if item.request.model.suffix.lower() == ".glb" and not item.model.animations:
            shutil.copyfile(item.request.model, own / entry["file"])
        else:
            write_gltf_model(own / entry["file"], item.model)
    for shot, key in zip(posed, job["keys"], strict=True):
        key["frame"] = shot.index + 1
    shots, camera = prepared.footage.shots, posed[0].view
    assert camera is not None  # these have one
    job |= {
        "environment": "environment.hdr",
        "size": [camera.camera.width, camera.camera.height],
        "first": shots[0].index + 1,
        "last": shots[-1].index + 1,
        "rate": frame_rate(shots),
    }
    (own / "job.json").write_text(json.dumps(job, indent=1) + "\n", encoding="utf-8")


def blender_program() -> list[str]:
    """The words that run a script in Blender. Raises InputError where there is no Blender."""
    stated = os.environ.get(VARIABLE)
    program = shutil.which(stated or "blender")
    if program is None:
        how = f"install Blender, or set {VARIABLE} to the Python of an environment with bpy (pip install bpy)"
        reason = f"found no program {stated!r}" if stated else "found no blender on PATH"
        raise InputError(f"--renderer blender: {reason}; {how}")
    if "python" in Path(program).name:
        return [program, str(_SCRIPT)]
    return [program, "--background", "--factory-startup", "--python", str(_SCRIPT), "--"]


def run_blender(job: Mapping[str, Any], folder: Path, progress: ProgressCallback = silent) -> None:
    """Run one job (`script.py` says what is in it); `folder` takes its files. Raises InputError if Blender fails."""
    file = folder / "job.json"
    file.write_text(json.dumps(job), encoding="utf-8")
    # Blender's Python must not see our packages
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    pictures = len(job["keys"]) if job.get("out") else 0
    status, log = _run([*blender_program(), str(file)], clean, folder, pictures, progress)
    if status != 0 or "Traceback" in log:
        last = next((line for line in reversed(log.splitlines()) if line.strip()), "no word")
        raise InputError(f"--renderer blender: Blender ended with status {status}: {last.strip()}")


def _run(
    words: list[str], environment: Mapping[str, str], folder: Path, pictures: int, progress: ProgressCallback
) -> tuple[int, str]:
    """The status of a program and what it said; its progress is the number of pictures in its folder."""
    file = folder / "log.txt"
    with file.open("w", encoding="utf-8") as log:
        process = subprocess.Popen(words, stdout=log, stderr=subprocess.STDOUT, env=dict(environment))
        try:
            while process.poll() is None:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(POLL_S)
                progress("Cycles", len(list(folder.glob("*.npy"))), pictures or None)
        finally:  # Ctrl-C ends it, too
            if process.poll() is None:
                process.kill()
                process.wait()
    return process.returncode, file.read_text(encoding="utf-8", errors="replace")


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
