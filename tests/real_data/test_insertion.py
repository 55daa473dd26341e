"""A virtual twin of a real bottle in the office: as high in the pictures as the bottle itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimator.instances.instance_reader import read_instances
from estimator.projection.cameras import pixels_in_view
from estimator.reconstructions.scene_reader import read_scene
from insertion.footage.footage import ImageSequence, Stills
from insertion.insertion_scene import build_scene
from insertion.request import ObjectRequest, PixelPosition
from insertion.scene.scale import MetricScale
from tests.synthetic.insertions import place_in, write_glb
from tests.synthetic.rooms.shapes import solid

#: The office's truth.json: metres per unit, and the bottle's height and diameter (0.294 +- 0.012).
SCALE, TRACK, SIZE = 0.37897, "4", np.array([0.100, 0.100, 0.294])
#: The frame in which its foot is pointed at.
FRAME = "1341847986.762616"


@pytest.mark.real_data
def test_a_twin_is_as_high_as_the_bottle(shared: Path, tmp_path: Path) -> None:
    scene = read_scene(shared / "data" / "scenes" / "tum_office")
    instances = read_instances(None, scene)
    stills = Stills(scene)
    prepared = build_scene(scene, stills, ImageSequence(stills), instances, MetricScale(SCALE, None, None, "option"))
    bottles = [item for item in instances if item.track == TRACK]
    shown = next(item for item in bottles if scene.views[item.view].name.startswith(FRAME))
    height, width = shown.mask.shape
    # the middle of the foot is a little above its front edge
    at = PixelPosition(FRAME, shown.origin[0] + width / 2, shown.origin[1] + height - 0.15 * width)
    model = write_glb(solid("bottle", SIZE), tmp_path / "bottle.glb")
    (twin,) = place_in(prepared, [ObjectRequest(model, at=at)])
    ratios = []
    for item in bottles:
        pixels, _ = pixels_in_view(scene.views[item.view], twin.body.position + twin.body.unit * twin.body.corners)
        if np.isfinite(pixels).all():
            ratios.append(float(np.ptp(pixels[:, 1])) / item.mask.shape[0])
    assert len(ratios) >= 8
    # the true height is known to 4 %, the depth of the foot to as much
    assert np.median(ratios) == pytest.approx(1.0, abs=0.08), ratios
