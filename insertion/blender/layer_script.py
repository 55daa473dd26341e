"""Script for the user's Blender (5.0): `blender -b -P scene.py`, or `python scene.py` with `bpy`.

It writes `scene.blend` to the folder of the layers (`insert-object --layers`) with two scenes. `joined` composites the
layers and renders the same frames. `objects` has the camera, the undistorted plate, the objects, their shadow catchers,
and a card in front of the camera that cuts out occluded pixels. Frame k is file k of each layer. `--render FOLDER`
renders all frames of both scenes.
"""

import argparse
import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import script  # type: ignore[import-not-found]  # noqa: E402  (in the same folder)

#: Distance of the card from the camera in metres.
CARD_M = 0.05


def main(argv: list[str]) -> None:
    """Build and save both scenes, and render them with `--render`."""
    parser = argparse.ArgumentParser(prog="scene.py", description=__doc__)
    parser.add_argument("--render", metavar="FOLDER", type=Path, help="folder for all frames of both scenes")
    parser.add_argument("--only", choices=("joined", "objects"), help="render only this scene")
    options = parser.parse_args(argv)
    job = json.loads((HERE / "job.json").read_text(encoding="utf-8"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    objects = bpy.context.scene
    objects.name = "objects"
    for item in job["objects"]:
        script.add_model(item | {"file": str(HERE / item["file"])})
    for catcher in job["catchers"]:
        script.add_catcher(catcher)
    script.set_world(objects, str(HERE / job["environment"]))
    camera = script.add_camera(objects, job)
    script.show_plate(objects, camera.data, sequence("undistorted", job), partial(play, job=job))
    add_card(objects, camera, job)
    joined = bpy.data.scenes.new("joined")
    join_layers(joined, job)
    for scene in (objects, joined):
        set_output(scene, job)
    bpy.ops.wm.save_as_mainfile(filepath=str(HERE.parent / "scene.blend"), compress=True, relative_remap=True)
    if options.render is not None:
        for scene in (scene for scene in (joined, objects) if options.only in (None, scene.name)):
            render(scene, options.render.resolve() / scene.name, job)


def add_card(scene: Any, camera: Any, job: dict[str, Any]) -> None:
    """Add a card that fills the image of the camera and cuts out the matte; it is invisible to light."""
    window = job["window"]
    half = np.array([window["width"] / window["fx"], window["height"] / window["fy"]]) * CARD_M / 2
    x = CARD_M * (window["width"] / 2 - window["cx"]) / window["fx"]
    y = CARD_M * (window["cy"] - window["height"] / 2) / window["fy"]
    mesh = bpy.data.meshes.new("occluders")
    corners = [(x + i * half[0], y + k * half[1], -CARD_M) for i, k in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    across = mesh.uv_layers.new(name="image")
    for row, at in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
        across.data[row].uv = at
    mesh.materials.append(card_material(job))
    card = bpy.data.objects.new("occluders", mesh)
    card.parent = camera
    for ray in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(card, f"visible_{ray}", False)
    scene.collection.objects.link(card)


def card_material(job: dict[str, Any]) -> Any:
    """Return a material that is a holdout for a matte of 1 and transparent for 0."""
    material = bpy.data.materials.new("matte")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    matte = nodes.new("ShaderNodeTexImage")
    matte.image, matte.interpolation, matte.extension = sequence("matte", job), "Linear", "EXTEND"
    matte.image.colorspace_settings.name = "Non-Color"
    play(matte.image_user, job)
    mix = nodes.new("ShaderNodeMixShader")
    links.new(matte.outputs["Color"], mix.inputs[0])
    links.new(nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
    links.new(nodes.new("ShaderNodeHoldout").outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def join_layers(scene: Any, job: dict[str, Any]) -> None:
    """Composite plate * shadow * (1 - A) + RGB, as in `layers.json`."""
    scene.camera = bpy.data.objects.new("no camera", bpy.data.cameras.new("no camera"))
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x, scene.render.resolution_y = job["size"]
    tree, output = script.compositor(scene)
    dimmed = tree.nodes.new("ShaderNodeMix")
    dimmed.data_type, dimmed.blend_type = "RGBA", "MULTIPLY"
    dimmed.inputs["Factor"].default_value = 1.0
    colours = [entry for entry in dimmed.inputs if entry.type == "RGBA"]
    tree.links.new(layer(tree, "plate", job).outputs["Image"], colours[0])
    tree.links.new(layer(tree, "shadow", job).outputs["Image"], colours[1])
    over = tree.nodes.new("CompositorNodeAlphaOver")
    result = next(entry for entry in dimmed.outputs if entry.type == "RGBA")
    tree.links.new(result, over.inputs["Background"])
    tree.links.new(layer(tree, "object", job).outputs["Image"], over.inputs["Foreground"])
    tree.links.new(over.outputs[0], output.inputs[0])


def layer(tree: Any, name: str, job: dict[str, Any]) -> Any:
    """A node that plays a layer."""
    node = tree.nodes.new("CompositorNodeImage")
    node.image, node.label = sequence(name, job), name
    play(node, job)
    return node


def sequence(name: str, job: dict[str, Any]) -> Any:
    """Return the files of a layer as an image sequence."""
    image = bpy.data.images.load(str(HERE.parent / name / f"{job['first']:06d}.exr"))
    image.name, image.source = name, "SEQUENCE"
    image.alpha_mode = "PREMUL"
    return image


def play(user: Any, job: dict[str, Any]) -> None:
    """Show file k in frame k."""
    # Blender counts the files of a sequence from 1
    user.frame_start, user.frame_offset, user.frame_duration = 0, -1, job["last"] + 1
    user.use_auto_refresh = True


def set_output(scene: Any, job: dict[str, Any]) -> None:
    """Set frames, rate and colour management, so that the colours of the layers are unchanged."""
    scene.frame_start, scene.frame_end = job["first"], job["last"]
    scene.frame_current = job["first"]
    script.use_cycles(scene)
    render = scene.render
    render.resolution_percentage, render.dither_intensity = 100, 0.0
    render.compositor_precision, render.compositor_device = "FULL", "CPU"
    render.fps = max(round(job["rate"]), 1)
    render.fps_base = render.fps / job["rate"]
    scene.cycles.device, scene.cycles.use_denoising = "CPU", scene.name == "objects"
    scene.cycles.samples = job["samples"] if scene.name == "objects" else 1
    settings = render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "8"


def render(scene: Any, folder: Path, job: dict[str, Any]) -> None:
    """Write a PNG file for each frame with a camera."""
    for key in job["keys"]:
        # an animation of one frame: a still image of a scene that is in no window does not update its sequences
        scene.frame_start = scene.frame_end = key["frame"]
        scene.render.filepath = str(folder / "######.png")
        bpy.ops.render.render(animation=True, scene=scene.name)


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [w for w in sys.argv[1:] if w != "-b"])
