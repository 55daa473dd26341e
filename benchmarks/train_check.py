"""Check the loop of export, training, registration and estimate on the CPU: `make train-check`.

Three steps, `sets`, `train` (repeated after a kill) and `scale`, work in one folder:

- `sets`: two sets of compositions of shipped cut-outs of four categories, for training and held out. The held-out
  compositions have other placements, sizes, lighting and backgrounds (frames of other empty rooms); their cut-outs are
  the same, because two of the categories have two items or fewer. And a rendered scene of these categories in another
  room: solids of revolution with the outline and the size of the items, painted with the cut-outs.
- `train`: `integrations/train_detector` with the small network. It is killed after the first checkpoint and continued.
- `scale`: mask AP50 of at least 0.5 on the held-out compositions, and the true scale within the 90 % interval of
  `estimate-scale --detector detector.toml`.

The items of the scene are rows of the tree: the check tests the loop, not the accuracy of the sizes.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from metric_tree.training.classes import Classes
from metric_tree.training.composition import Cutout, cutout_pixels, cutouts_of
from metric_tree.training.dataset import Plan, export_dataset
from metric_tree.training.selection import named_nodes
from metric_tree.tree import open_tree
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.rooms.render import Frame, Renderer
from tests.synthetic.rooms.scene_files import write_scene
from tests.synthetic.rooms.solids import Mesh, revolution, rotate, stretch_to
from tests.synthetic.rooms.world import Placed, World

CATEGORIES = ("traffic cone", "trash can", "fire hydrant", "barrel")
#: Number and size in pixels of the compositions. Small images keep the training short on a CPU.
TRAINING_IMAGES, HELD_OUT_IMAGES, SIZE = 400, 100, (256, 192)
#: Seeds of the empty rooms behind the compositions of the two sets, and of the room of the scene.
TRAINING_ROOMS, HELD_OUT_ROOMS, SCENE_ROOM = range(8), range(20, 24), 40
KINDS = ("sitting room", "kitchen", "bedroom")
#: Minimum mask AP50 on the held-out compositions.
MIN_AP50 = 0.5
#: Positions (x, y) in metres of the objects of the scene.
POSITIONS = [(x + shift, y) for y, shift in ((0.2, 0.0), (1.5, 0.4)) for x in (-1.5, -0.5, 0.5, 1.5)]
#: Number of rows of the outline of a solid.
N_RINGS = 40
ROOT = Path(__file__).parents[1]
TRAINER = ROOT / "integrations" / "train_detector" / "train_detector.py"
#: Options of the training. The network is trained from random weights.
TRAINING = (
    "--backbone resnet18 --device cpu --workers 1 --short-side 128 --batch 4 --rate 1e-3 --steps 1200 --save-every 25"
)


def make_sets(folder: Path) -> None:
    """Write the set of training, with the held-out compositions as its validation, and the scene."""
    tree = open_tree()
    classes = Classes(tree, named_nodes(tree, ",".join(CATEGORIES)))
    cutouts = cutouts_of(classes, seed=0)
    for name, rooms, images in (
        ("train", TRAINING_ROOMS, TRAINING_IMAGES),
        ("held_out", HELD_OUT_ROOMS, HELD_OUT_IMAGES),
    ):
        backgrounds = [file for room in rooms for file in write_empty_room(folder / f"rooms_{name}", room)]
        plan = Plan(images, SIZE, val_share=0, seed=rooms[0], backgrounds=tuple(backgrounds), jobs=2)
        export_dataset(folder / name, classes, cutouts, plan)
    document = json.loads((folder / "held_out" / "annotations" / "instances_train.json").read_text())
    for image in document["images"]:
        image["file_name"] = f"../../held_out/images/{image['file_name']}"
    (folder / "train" / "annotations" / "instances_val.json").write_text(json.dumps(document))
    scene = write_detector_scene(folder / "scene", cutouts, [node.name for node in classes.nodes])
    print(
        f"{TRAINING_IMAGES} and {HELD_OUT_IMAGES} compositions of {len(cutouts)} cut-outs; a scene of {scene} objects"
    )


def write_empty_room(folder: Path, seed: int) -> list[Path]:
    """Write every sixth frame of a room without objects."""
    folder.mkdir(parents=True, exist_ok=True)
    world = replace(furnished_room(KINDS[seed % len(KINDS)], seed), objects=())
    files = []
    with Renderer(world) as renderer:
        for index in range(0, len(world.poses), 6):
            colour = renderer.frame(index).colour
            assert colour is not None
            files.append(folder / f"{seed:02d}_{index:02d}.jpg")
            cv2.imwrite(str(files[-1]), colour[:, :, ::-1])
    return files


def write_detector_scene(folder: Path, cutouts: list[Cutout], names: list[str]) -> int:
    """Write a COLMAP model, images and the truth of a room with two objects per category; return their number."""
    items = list({cutout.item_id: cutout for cutout in cutouts}.values())
    chosen = [(k, [one for one in items if one.category == k]) for k in range(1, len(names) + 1)]
    objects, paints = [], []
    for index, position in enumerate(POSITIONS):
        category, group = chosen[index % len(chosen)]
        cutout = group[(index // len(chosen)) % len(group)]
        mesh, size = solid_of(cutout)
        mesh = rotate(mesh, np.eye(3), np.array([*position, 0.0]))
        objects.append(Placed(f"{names[category - 1]} {index}", names[category - 1], names[category - 1], size, mesh))
        paints.append(cutout_pixels(cutout)[0])
    world = replace(furnished_room("sitting room", SCENE_ROOM, Knobs(views=16)), objects=tuple(objects))
    write_scene(quick_scene(world, Knobs(views=16), seed=SCENE_ROOM, dense_a_frame=0), world, folder)
    (folder / "instances.json").unlink()  # the detector is to find the objects
    (folder / "images").mkdir()
    with Renderer(world) as renderer:
        for index in range(len(world.poses)):
            image = painted(renderer.frame(index), world, index, paints)
            cv2.imwrite(str(folder / "images" / f"frame{index:03d}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 92])
    return len(objects)


def solid_of(cutout: Cutout) -> tuple[Mesh, np.ndarray]:
    """Return the solid of revolution of the outline of a cut-out, with the height of its item, and its size (3,)."""
    opaque = cutout_pixels(cutout)[0][:, :, 3] >= 128
    rows = np.linspace(len(opaque) - 1, 0, N_RINGS).round().astype(int)  # from the bottom
    radii = opaque[rows].sum(axis=1) / 2
    profile = [(max(float(radius), 0.5), float(len(opaque) - row)) for row, radius in zip(rows, radii, strict=True)]
    height = cutout.sizes_mm[0] / 1000
    diameter = 2 * radii.max() / len(opaque) * height
    size = np.array([diameter, diameter, height])
    return stretch_to(revolution(profile, "paint"), size), size


def painted(frame: Frame, world: World, index: int, paints: list[np.ndarray]) -> np.ndarray:
    """Return the frame (H, W, 3), BGR, with the cut-outs painted on their solids."""
    assert frame.colour is not None
    image = frame.colour[:, :, ::-1].copy()
    pose, camera = world.poses[index], world.camera
    for number, (item, paint) in enumerate(zip(world.objects, paints, strict=True), start=1):
        is_shown = frame.ids == number
        if not is_shown.any():
            continue
        local = item.mesh.vertices @ pose.rotation.T + pose.translation
        pixels = camera.focal * local[:, :2] / local[:, 2:] + [camera.width / 2, camera.height / 2]
        (x0, y0), (x1, y1) = pixels.min(axis=0), pixels.max(axis=0)
        filled = cv2.inpaint(paint[:, :, :3].copy(), (paint[:, :, 3] < 200).astype(np.uint8), 3, cv2.INPAINT_NS)
        height, width = paint.shape[:2]
        to_image = np.array([[(x1 - x0) / width, 0, x0], [0, (y1 - y0) / height, y0]])
        size = (camera.width, camera.height)
        warped = cv2.warpAffine(filled, to_image, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
        image[is_shown] = warped[is_shown]
    return image


def train(folder: Path, python: str, options: str) -> None:
    """Train in another environment; kill the training after its first checkpoint and continue it."""
    command = [python, str(TRAINER), str(folder / "train"), "--out", str(folder / "trained"), *options.split()]
    # One thread needs 0.65 s of processor per step; two, which wait actively for each other, took 4.6 s beside other
    # work.
    environment = {"OMP_NUM_THREADS": "1", **os.environ}
    checkpoint = folder / "trained" / "checkpoint.pt"
    if not checkpoint.exists():
        with subprocess.Popen(command, env=environment) as process:
            while process.poll() is None and not checkpoint.exists():
                time.sleep(0.5)
            process.send_signal(signal.SIGKILL)
        assert checkpoint.exists(), "the training ended without a checkpoint"
        print("killed after the first checkpoint; continued by the same command", flush=True)
    subprocess.run(command, check=True, env=environment)


def check_scale(folder: Path) -> int:
    """Check the mask AP50 and the interval of the scale; return the exit status."""
    ap50 = json.loads((folder / "trained" / "mask_ap.json").read_text())["mean"]["AP50"]
    print(f"mask AP50 on held-out compositions: {ap50:.3f} (at least {MIN_AP50})")
    program = [str(Path(sys.executable).with_name("estimate-scale")), str(folder / "scene"), "--json"]
    detector = ["--detector", str(folder / "trained" / "detector.toml")]
    result = json.loads(subprocess.run([*program, *detector], check=True, capture_output=True, text=True).stdout)
    truth = json.loads((folder / "scene" / "truth.json").read_text())["metres_per_unit"]
    low, high = result["interval"]["low"], result["interval"]["high"]
    print(f"scale {result['scale']:.4g}, 90 % interval {low:.4g} to {high:.4g}; true {truth:.4g} metres per unit")
    return 0 if ap50 >= MIN_AP50 and low <= truth <= high else 1


def main() -> int:
    """Run one of the steps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", choices=("sets", "train", "scale"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--python", default=sys.executable, help="interpreter with the extra `train`")
    parser.add_argument("--options", default=TRAINING, help="options of the training (default: %(default)s)")
    options = parser.parse_args()
    if options.step == "sets":
        make_sets(options.folder)
    elif options.step == "train":
        train(options.folder, options.python, options.options)
    else:
        return check_scale(options.folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
