"""Run Blender: images of the objects by Cycles, `.blend` files, and the script of `--layers` for the user's Blender.

Blender has the licence GPL and requires an exact version of Python, so it runs in a separate process. The environment
variable `METRIC_TREE_BLENDER` names a `blender` program or the Python of an environment with `bpy`; the default is
`blender` on PATH.
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

import cv2
import numpy as np
from numpy.typing import NDArray

from insertion.blender.job import ideal_window, insertion_job
from insertion.colour import srgb_to_linear
from insertion.composite.camera_look import measure_gain
from insertion.exports.compositing import exr_bytes, lens_maps
from insertion.exports.export_folder import image_names
from insertion.exports.metric_frame import frame_rate
from insertion.footage.footage import Footage, Frame
from insertion.light.environment_map import Environment
from insertion.placement.placed_object import PlacedObject
from insertion.render.layers import through_lens
from insertion.scene.frame_masks import FrameContent
from insertion.scene.pixel_box import PixelBox
from metric_base.errors import InputError
from metric_base.progress import ProgressCallback, silent
from models3d.gltf.model_writer import write_gltf_model

_SCRIPTS = {"scene.py": "layer_script.py", "script.py": "script.py"}
VARIABLE = "METRIC_TREE_BLENDER"
#: Interval between two updates of the progress in seconds.
POLL_S = 0.2
_SCRIPT = Path(__file__).with_name("script.py")
Layer = NDArray[np.float32]


def write_layer_scene(
    folder: Path, objects: Sequence[PlacedObject], frames: Sequence[Frame], environment: Environment
) -> None:
    """Write the script and its inputs to `folder / "blender"`; frames without a pose have no camera keyframe."""
    target = folder / "blender"
    target.mkdir()
    for name, source in _SCRIPTS.items():
        shutil.copyfile(Path(__file__).with_name(source), target / name)
    posed = [frame for frame in frames if frame.view is not None]
    job = insertion_job(objects, posed, environment, target)
    for number, (item, entry) in enumerate(zip(objects, job["objects"], strict=True), start=1):
        entry["file"] = f"model{number}.glb"
        if item.request.model.suffix.lower() == ".glb" and not item.model.animations:
            shutil.copyfile(item.request.model, target / entry["file"])
        else:
            write_gltf_model(target / entry["file"], item.model)
    for frame, key in zip(posed, job["keys"], strict=True):
        key["frame"] = frame.index
    camera = posed[0].view
    assert camera is not None  # they have a pose
    job |= {
        "environment": "environment.hdr",
        "size": [camera.camera.width, camera.camera.height],
        "first": frames[0].index,
        "last": frames[-1].index,
        "rate": frame_rate(frames),
    }
    (target / "job.json").write_text(json.dumps(job, indent=1) + "\n", encoding="utf-8")


def blender_program(script: Path = _SCRIPT) -> list[str]:
    """Return the command that runs a script in Blender. Raises InputError if Blender is not installed."""
    stated = os.environ.get(VARIABLE)
    program = shutil.which(stated or "blender")
    if program is None:
        how = f"install Blender, or set {VARIABLE} to the Python of an environment with bpy (pip install bpy)"
        reason = f"found no program {stated!r}" if stated else "found no blender on PATH"
        raise InputError(f"--renderer blender: {reason}; {how}")
    if "python" in Path(program).name:
        return [program, str(script)]
    return [program, "--background", "--factory-startup", "--python", str(script), "--"]


def run_blender(
    job: Mapping[str, Any], folder: Path, progress: ProgressCallback = silent, script: Path = _SCRIPT
) -> None:
    """Run a job (see `script.py`) by a script with its files in `folder`. Raises InputError if Blender fails."""
    file = folder / "job.json"
    file.write_text(json.dumps(job), encoding="utf-8")
    # Blender's Python must not find the packages of this environment
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    n_images = len(job["keys"]) if job.get("out") else 0
    log_file = folder / "log.txt"
    with log_file.open("w", encoding="utf-8") as log:
        argv = [*blender_program(script), str(file)]
        process = subprocess.Popen(argv, stdout=log, stderr=subprocess.STDOUT, env=environment)
        try:
            while process.poll() is None:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(POLL_S)
                progress("Cycles", len(list(folder.glob("*.npy"))), n_images or None)
        finally:  # also after Ctrl-C
            if process.poll() is None:
                process.kill()
                process.wait()
    text = log_file.read_text(encoding="utf-8", errors="replace")
    if process.returncode != 0 or "Traceback" in text:
        last = next((line for line in reversed(text.splitlines()) if line.strip()), "no word")
        raise InputError(f"--renderer blender: Blender ended with status {process.returncode}: {last.strip()}")


@contextmanager
def traced_layers(
    objects: Sequence[PlacedObject],
    footage: Footage,
    content: FrameContent,
    environment: Environment,
    progress: ProgressCallback = silent,
) -> Iterator[Callable[[Frame], Layer]]:
    """Provide a function that returns the layer (h, w, 4) of a frame through the lens; one run renders all frames.

    Glass transmits the frames with the exposure of the light, which is that of the colours of the cloud.
    """
    posed = [frame for frame in footage.frames if frame.view is not None]
    with tempfile.TemporaryDirectory(prefix="insert-object-") as name:
        folder = Path(name)
        job = insertion_job(objects, posed, environment, folder)
        keys = {frame.index: key for frame, key in zip(posed, job["keys"], strict=True)}
        for frame, image in footage:
            if frame.view is not None:
                gain = measure_gain(image, content.at(frame).points, content.cloud)
                light = np.dstack([srgb_to_linear(image) / gain, np.ones(image.shape[:2])]).astype(np.float32)
                back = lens_maps(frame.view.camera)[1]
                file = folder / f"plate{frame.index}.exr"
                file.write_bytes(exr_bytes(cv2.remap(light, back[..., 0], back[..., 1], cv2.INTER_LINEAR)))
                keys[frame.index]["plate"] = str(file)
        run_blender(job | {"out": str(folder)}, folder, progress)

        def layer(frame: Frame) -> Layer:
            assert frame.view is not None  # other frames have no objects
            ideal = np.load(folder / f"{keys[frame.index]['stem']}.npy", allow_pickle=False).astype(np.float32)
            camera = frame.view.camera
            return through_lens(ideal, frame.view, PixelBox(0, 0, camera.width, camera.height))

        yield layer


def export_blend(
    folder: Path, objects: Sequence[PlacedObject], frames: Sequence[Frame], environment: Environment
) -> list[str]:
    """Write `scene.blend` to the folder, with the animated camera and all resources, if Blender is installed.

    Returns
    -------
    list of str
        A line for each file that was not written.
    """
    try:
        blender_program()
    except InputError:
        return [f"scene.blend is not written: there is no Blender (on PATH, or named by {VARIABLE})"]
    with tempfile.TemporaryDirectory(prefix="insert-object-") as name:
        temporary = Path(name)
        job = insertion_job(objects, frames, environment, temporary, ideal_window)
        first = f"pictures/{next(iter(image_names(frames).values())).as_posix()}"
        # names of frames of a video are their numbers; of other images the first one is shown
        numbered = [frame.index for frame in frames if frame.name == f"{frame.index:06d}.png"]
        plates = {"file": first, "number": frames[0].index, "count": len(numbered) or 1}
        plates = plates if (folder / first).is_file() else {}
        run_blender(
            job | {"blend": str(folder.resolve() / "scene.blend"), "rate": frame_rate(frames), "plates": plates},
            temporary,
        )
    return []
