"""Read the GLB of DUSt3R, MASt3R and their descendants: a cloud, and the cameras from their drawings.

The demos (dust3r/viz.py, `add_scene_cam`) draw each camera as a textured rectangle in front of it and a pyramid behind
the rectangle, whose apex is the centre of the camera. The corners of the texture state its orientation. The file has no
sizes and names of images: cameras get the longer side of the network.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from estimator.records.scene import DenseCloud, Scene
from estimator.scene_formats.common import glb_parts, pinhole_camera, posed_view
from estimator.scene_formats.networks import image_names
from metric_base.errors import Unquoted, at_field, expect, in_file

#: Longer side in pixels of the images of the network (512) in its standard form.
LONGER_SIDE = 512
#: Numbers of vertices of the rectangle of a camera.
CORNERS = 4


def read_dust3r(file: Path) -> Scene:
    """Read a GLB file with a cloud (points or a mesh) and cameras with their images.

    Raises
    ------
    InputError
        The file is damaged, or has no cloud or no cameras with images.
    """
    with in_file(file):
        parts = glb_parts(file)
        drawn = [(uv, screen, tip) for (screen, uv), (tip, _) in itertools.pairwise(parts) if len(uv) == CORNERS]
        expected = "cameras with their images (the demo draws them unless its cameras are transparent)"
        expect(drawn, "cameras", expected, Unquoted("none"))
        cameras = []
        for row, (uv, screen, tip) in enumerate(drawn):
            with at_field(f"camera {row}"):
                # The corners of a texture: u to the right, v downwards.
                corner = {
                    tuple(place): point for place, point in zip(uv.round().astype(int).tolist(), screen, strict=True)
                }
                expect(len(corner) == CORNERS, "texture", "its four corners", uv.tolist())
                right, down = corner[1, 0] - corner[0, 0], corner[0, 1] - corner[0, 0]
                width, height = np.linalg.norm(right), np.linalg.norm(down)
                forward = np.cross(right / width, down / height)
                distances = (screen.mean(axis=0) - tip) @ forward
                apex = int(np.abs(distances).argmax())
                unit = LONGER_SIDE / max(width, height)
                focal = float(distances[apex] * unit)
                size = (round(width * unit), round(height * unit))
                lens = pinhole_camera(size, (focal, focal), (size[0] / 2, size[1] / 2), {})
                cameras.append((lens, np.stack([right / width, down / height, forward]), tip[apex]))
        shape = (len(cameras), cameras[0][0].height, cameras[0][0].width)
        names, warnings = image_names(file, "images", shape)
        views = [posed_view(name, *camera) for name, camera in zip(names, cameras, strict=True)]
    cloud = max((points for points, _ in parts), key=len)
    return Scene(file.parent, "network", tuple(views), np.empty((0, 3)), DenseCloud(cloud), warnings, file.parent)
