"""Script for the Python of Blender: `blender -b -P script.py -- JOB.json`, or `python script.py JOB.json` with `bpy`.

The job (see `job.py`) has models with matrices, cameras, lights and outputs, in metres with +y up. Blender has +z up.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

#: Rotation from +y up to +z up, as in the glTF importer of Blender.
TURN = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=float)


def main(job: dict[str, Any]) -> None:
    """Build the scene, then save and render the outputs of the job."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    for item in job["objects"]:
        add_model(item)
    for catcher in job["catchers"]:
        add_catcher(catcher)
    set_world(scene, job["environment"])
    use_cycles(scene)
    camera = add_camera(scene, job)
    if job.get("blend"):
        bpy.ops.file.pack_all()  # the file of the environment is temporary
        if job.get("plates"):
            add_plates(scene, camera.data, Path(job["blend"]).parent, job["plates"])
        bpy.ops.wm.save_as_mainfile(filepath=job["blend"], compress=True)
    if job.get("out"):
        render(scene, camera, job)


def add_model(item: dict[str, Any]) -> None:
    """Import a glTF file and set its matrix."""
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=item["file"])
    new = [entry for entry in bpy.data.objects if entry not in before]
    anchor = bpy.data.objects.new("anchor", None)
    bpy.context.scene.collection.objects.link(anchor)
    for entry in new:
        if entry.animation_data:
            entry.animation_data_clear()
        if entry.parent is None:
            entry.parent = anchor
    anchor.matrix_world = Matrix((TURN @ np.array(item["matrix"]) @ np.linalg.inv(TURN)).tolist())


def add_catcher(catcher: dict[str, Any]) -> None:
    """Add a shadow catcher with `corners` (4, 3), which reflects light onto the objects.

    The albedo is `albedo`, or with a plate (`project_plate`) `albedo_per_radiance` times its radiance.
    """
    mesh = bpy.data.meshes.new("support")
    corners = np.array(catcher["corners"]) @ TURN[:3, :3].T
    mesh.from_pydata([tuple(corner) for corner in corners.tolist()], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("support")
    material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = (*catcher["albedo"], 1)
    surface.inputs["Roughness"].default_value = 0.9
    mesh.materials.append(material)
    entry = bpy.data.objects.new("support", mesh)
    entry.is_shadow_catcher, entry["albedo_per_radiance"] = True, catcher["albedo_per_radiance"]
    bpy.context.scene.collection.objects.link(entry)


def set_world(scene: Any, file: str) -> None:
    """Set an equirectangular image as the environment."""
    world = bpy.data.worlds.new("world")
    scene.world = world
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    background = nodes["Background"]
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.load(file)
    texture.image.colorspace_settings.name = "Linear Rec.709"
    links.new(texture.outputs["Color"], background.inputs["Color"])


def add_camera(scene: Any, job: dict[str, Any]) -> Any:
    """Add the undistorted camera of the window of the job, with a keyframe at the time or `frame` of each key."""
    data = bpy.data.cameras.new("recovered camera")
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = 36.0
    data.clip_start, data.clip_end = 0.01, 1000.0
    camera = bpy.data.objects.new("recovered camera", data)
    camera.rotation_mode = "QUATERNION"
    scene.collection.objects.link(camera)
    scene.camera = camera
    rate = job.get("rate", 6.0)
    scene.render.fps = max(round(rate), 1)
    scene.render.fps_base = scene.render.fps / rate
    start = job.get("start_s", job["keys"][0]["time_s"])
    several = len({json.dumps(key.get("window")) for key in job["keys"]}) > 1
    set_lens(scene, data, job["window"])
    turn = None
    for key in job["keys"]:
        camera.matrix_world = Matrix((TURN @ np.array(key["matrix"])).tolist())
        if turn is not None:  # of the two signs of a quaternion, the one with the shorter rotation
            camera.rotation_quaternion.make_compatible(turn)
        turn = camera.rotation_quaternion.copy()
        frame = key.get("frame", (key["time_s"] - start) * rate)
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_quaternion", frame=frame)
        if several:  # Blender cannot animate the size of the image
            set_lens(scene, data, key["window"])
            for path in ("lens", "shift_x", "shift_y"):
                data.keyframe_insert(path, frame=frame)
    set_lens(scene, data, job["window"])
    scene.frame_start = scene.frame_current = 0
    scene.frame_end = max(0, round((job["keys"][-1]["time_s"] - start) * rate))
    return camera


def use_cycles(scene: Any) -> None:
    """Render by Cycles with a transparent background, because EEVEE has no shadow catchers, and keep colours."""
    scene.render.engine, scene.render.film_transparent = "CYCLES", True
    scene.view_settings.view_transform, scene.view_settings.look = "Standard", "None"


def add_plates(scene: Any, data: Any, folder: Path, plates: dict[str, Any]) -> None:
    """Show the images of a folder behind the camera: `file`, relative, is the first of `count` numbered ones."""
    image = bpy.data.images.load(str(folder / plates["file"]))
    image.filepath = f"//{plates['file']}"  # the folder will be renamed
    image.source = "SEQUENCE" if plates["count"] > 1 else "FILE"

    def play(user: Any) -> None:
        user.frame_start, user.frame_offset, user.frame_duration = 0, plates["number"] - 1, plates["count"]
        user.use_auto_refresh = True

    show_plate(scene, data, image, play)


def show_plate(scene: Any, data: Any, image: Any, play: Callable[[Any], None]) -> None:
    """Show an image behind a camera, composite the rendered image over it, and project it (see `project_plate`)."""
    data.show_background_images = True
    background = data.background_images.new()
    background.image = image
    play(background.image_user)
    project_plate(scene, image, play)
    if not hasattr(scene, "compositing_node_group"):  # Blender 4
        return
    tree, output = compositor(scene)
    plate, rendered, over = (tree.nodes.new(f"CompositorNode{kind}") for kind in ("Image", "RLayers", "AlphaOver"))
    plate.image, rendered.scene = image, scene
    play(plate)
    tree.links.new(plate.outputs["Image"], over.inputs["Background"])
    tree.links.new(rendered.outputs["Image"], over.inputs["Foreground"])
    tree.links.new(over.outputs[0], output.inputs[0])


def project_plate(scene: Any, image: Any, play: Callable[[Any], None]) -> None:
    """Let glass transmit an image of the camera, and give its colours to the supports; `play` sets its frames.

    Positions are projected into the image; the background of the world is infinitely far away. The environment and the
    albedo of the supports are used for positions that the image does not show.
    """
    world = scene.world.node_tree
    transmitted = world.nodes.new("ShaderNodeLightPath").outputs["Is Transmission Ray"]
    inputs = [(world, world.nodes["Background"].inputs["Color"], transmitted, (1.0, 1.0, 1.0))]
    for entry in (entry for entry in scene.objects if entry.is_shadow_catcher):
        tree = entry.data.materials[0].node_tree
        inputs.append((tree, tree.nodes["Principled BSDF"].inputs["Base Color"], None, entry["albedo_per_radiance"]))
    for tree, colour, rays, factor in inputs:
        position, plate, weight, scaled, mix = (
            tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "TexImage", "Math", "VectorMath", "Mix")
        )
        plate.image, plate.extension = image, "CLIP"  # the alpha is 0 outside of the image
        play(plate.image_user)
        tree.links.new(position.outputs["Window"], plate.inputs["Vector"])
        tree.links.new(plate.outputs["Alpha"], weight.inputs[0])
        weight.operation, weight.inputs[1].default_value = "MULTIPLY", 1.0
        if rays is not None:
            tree.links.new(rays, weight.inputs[1])
        scaled.operation, scaled.inputs[1].default_value = "MULTIPLY", factor
        tree.links.new(plate.outputs["Color"], scaled.inputs[0])
        mix.data_type, mix.clamp_result = "RGBA", rays is None  # an albedo is at most 1
        first, second = (entry for entry in mix.inputs if entry.type == "RGBA")
        first.default_value = colour.default_value
        if colour.is_linked:
            tree.links.new(colour.links[0].from_socket, first)
        tree.links.new(weight.outputs[0], mix.inputs["Factor"])
        tree.links.new(scaled.outputs["Vector"], second)
        tree.links.new(next(entry for entry in mix.outputs if entry.type == "RGBA"), colour)


def compositor(scene: Any) -> tuple[Any, Any]:
    """Return an empty compositor of a scene, and its output node."""
    tree = bpy.data.node_groups.new(scene.name, "CompositorNodeTree")
    tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    scene.compositing_node_group = tree
    return tree, tree.nodes.new("NodeGroupOutput")


def set_lens(scene: Any, data: Any, window: dict[str, float]) -> None:
    """Set the undistorted camera of a window and the size of the image."""
    data.lens = 36.0 * window["fx"] / window["width"]
    data.shift_x = (window["width"] / 2 - window["cx"]) / window["width"]
    # Blender measures both shifts in widths of the image, with square pixels
    data.shift_y = (window["cy"] - window["height"] / 2) / window["width"] * window["fx"] / window["fy"]
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = window["width"], window["height"], 100
    render.pixel_aspect_y = window["fx"] / window["fy"] if window["fx"] > window["fy"] else 1.0
    render.pixel_aspect_x = window["fy"] / window["fx"] if window["fy"] > window["fx"] else 1.0


def render(scene: Any, camera: Any, job: dict[str, Any]) -> None:
    """Write a `.npy` (h, w, 4) of linear premultiplied light per keyframe, with the top row first."""
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_denoising = "CPU", job["samples"], True
    cycles.use_adaptive_sampling, cycles.max_bounces, cycles.seed = True, 6, 0
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    scene.render.use_persistent_data = True
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    camera.animation_data_clear()
    camera.data.animation_data_clear()
    plate = None
    for key in job["keys"]:
        camera.matrix_world = Matrix((TURN @ np.array(key["matrix"])).tolist())
        set_lens(scene, camera.data, key.get("window", job["window"]))
        if plate is not None:
            plate.filepath = key["plate"]
        elif "plate" in key:
            plate = bpy.data.images.load(key["plate"])
            project_plate(scene, plate, lambda _: None)
        file = f"{job['out']}/{key['stem']}.exr"
        scene.render.filepath = file
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(file)
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        height, width = image.size[1], image.size[0]
        np.save(f"{job['out']}/{key['stem']}.npy", pixels.reshape(height, width, 4)[::-1].astype(np.float16))
        Path(file).unlink()
        bpy.data.images.remove(image)


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    main(json.loads(Path(arguments[0]).read_text(encoding="utf-8")))
