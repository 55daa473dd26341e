"""The scene made ready for insertion: cloud, support planes, masks by view, scale."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np

from estimator.records.objects import Up
from estimator.records.scene import Instance, Scene
from insertion.footage.footage import Footage, FrameRange, Shot, Stills
from insertion.light.environment_estimate import Outdoors, shows_sky
from insertion.light.lamp_candidates import shown_empty
from insertion.light.lamp_fit import Shading, fit_shading
from insertion.light.sun import sun_direction
from insertion.scene.frame_masks import MaskCarrier
from insertion.scene.occupancy import occupancy_of
from insertion.scene.plane_cells import plane_patches
from insertion.scene.point_cloud import Cloud, coloured_cloud
from insertion.scene.scale import MetricScale
from insertion.scene.supports import Supports, supports_of
from metric_base.errors import InputError


@dataclass(frozen=True, slots=True, eq=False)
class PreparedScene:
    """Everything about the scene that does not depend on an object; shading is found when it is first asked for.

    moving : by the number of a shot, the masks of what moves in it.
    """

    scene: Scene
    stills: Stills
    footage: Footage
    cloud: Cloud
    supports: Supports
    instances: tuple[Instance, ...]
    scale: MetricScale
    carrier: MaskCarrier
    shading: Callable[[], Shading | Outdoors | None]
    moving: Mapping[int, tuple[Instance, ...]] = field(default_factory=dict)

    @property
    def start_s(self) -> float:
        """When the first picture of the whole footage is shown."""
        whole = self.footage.whole if isinstance(self.footage, FrameRange) else self.footage
        return whole.shots[0].clock_s if whole.shots else 0.0

    def with_frames(self, frames: tuple[int, int]) -> PreparedScene:
        """It with the shots from the first to the last number of `frames`. Raises InputError if there are none."""
        footage = FrameRange(self.footage, *frames)
        if not footage.shots:
            last = len(self.footage.shots) - 1
            raise InputError(f"--frames: expected numbers from 0 to {last}; found {frames[0]}:{frames[1]}")
        return replace(self, footage=footage)

    def masks(self, shot: Shot) -> Sequence[Instance]:
        """The masks of a shot, carried over from the nearest annotated view where it has none of its own."""
        if shot.view is None:
            return ()
        # the frames of a video may be larger than those that were reconstructed
        own = shot.row is not None and self.scene.views[shot.row].camera.width == shot.view.camera.width
        return self.carrier.masks(shot.row if own else None, shot.view)


def prepare_scene(
    scene: Scene,
    stills: Stills,
    footage: Footage,
    instances: Sequence[Instance],
    scale: MetricScale,
    up: Up | None = None,
) -> PreparedScene:
    """A scene prepared for insertion; reads the stills once for the cloud's colours. up : if it is known."""
    by_view: dict[int, list[Instance]] = defaultdict(list)
    for item in instances:
        if not item.from_box:  # a box has no edge to hide behind
            by_view[item.view].append(item)
    cloud = coloured_cloud(scene, stills)
    supports = supports_of(scene, cloud, up)
    return PreparedScene(
        scene,
        stills,
        footage,
        cloud,
        supports,
        tuple(instances),
        scale,
        MaskCarrier(scene, by_view, cloud),
        cache(lambda: _shading(scene, stills, cloud, supports)),
    )


def _shading(scene: Scene, stills: Stills, cloud: Cloud, supports: Supports) -> Shading | Outdoors | None:
    """The lamps of the scene, or the sun; takes a second or two, hence only when something is drawn."""
    up = supports.up.vector
    if shows_sky(cloud, stills, up):
        ground = supports.ground(cloud)
        return Outdoors(None if ground is None else sun_direction(cloud, stills, ground.plane))
    centres = np.array([view.centre for view in scene.views])
    patches = plane_patches(cloud, centres)
    if not len(patches.places):
        return None
    empty = partial(shown_empty, cloud=cloud, stills=stills)
    return fit_shading(patches, up, empty, occupancy_of(cloud))
