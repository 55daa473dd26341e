"""A virtual copy of a real bottle in an office has the height of the bottle in the images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimator.instances.instance_reader import read_instances
from estimator.projection.cameras import pixels_in_view
from estimator.reconstructions.scene_reader import read_scene
from insertion.footage.footage import ImageSequence, SceneImages
from insertion.insertion_scene import build_scene
from insertion.request import ObjectRequest, PixelPosition
from insertion.scene.scale import MetricScale
from tests.synthetic.insertions import place_in, write_glb
from tests.synthetic.rooms.shapes import solid

#: Scale, track and size of the bottle in the office's truth.json; the height is 0.294 +- 0.012 m.
SCALE, TRACK, SIZE = 0.37897, "4", np.array([0.100, 0.100, 0.294])
#: Frame in which the position is selected.
FRAME = "1341847986.762616"


@pytest.mark.real_data
def test_virtual_bottle_has_the_image_height_of_the_real_one(shared: Path, tmp_path: Path) -> None:
    scene = read_scene(shared / "data" / "scenes" / "tum_office")
    instances = read_instances(None, scene)
    images = SceneImages(scene)
    prepared = build_scene(scene, images, ImageSequence(images), instances, MetricScale(SCALE, None, None, "option"))
    bottles = [item for item in instances if item.track == TRACK]
    bottle = next(item for item in bottles if scene.views[item.view].name.startswith(FRAME))
    height, width = bottle.mask.shape
    # the centre of the base is slightly above its front edge
    at = PixelPosition(FRAME, bottle.origin[0] + width / 2, bottle.origin[1] + height - 0.15 * width)
    model = write_glb(solid("bottle", SIZE), tmp_path / "bottle.glb")
    (copy,) = place_in(prepared, [ObjectRequest(model, at=at)])
    ratios = []
    for item in bottles:
        pixels, _ = pixels_in_view(scene.views[item.view], copy.body.position + copy.body.unit * copy.body.corners)
        if np.isfinite(pixels).all():
            ratios.append(float(np.ptp(pixels[:, 1])) / item.mask.shape[0])
    assert len(ratios) >= 8
    # the true height and the depth of the base are known to 4 % each
    assert np.median(ratios) == pytest.approx(1.0, abs=0.08), ratios
