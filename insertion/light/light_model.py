"""The light of a scene: sun and sky outdoors, lamps in a room; and the environment map at any position.

The sun is sought if at least 5 % of the pixels are sky (`is_outdoors`), or if the cameras look down so that no image
can show the sky. It is used if shadows on the ground determine its direction (`insertion.light.sun`). A part of an
object is in the shade if the occupancy grid is occupied between it and the sun (`ObjectRenderer._sunlit_fraction`).
"""

from __future__ import annotations

from functools import cached_property, partial

import numpy as np

from estimator.geometry.planes import level_basis
from estimator.records.scene import Scene, camera_centres
from insertion.footage.footage import SceneImages
from insertion.light.environment_estimate import OutdoorLight, environment_at, is_outdoors, looks_down
from insertion.light.environment_map import Environment
from insertion.light.lamp_candidates import is_visibly_free
from insertion.light.lamp_fit import RoomLight, fit_room_light
from insertion.light.sun import sun_direction
from insertion.scene.occupancy import occupancy_of
from insertion.scene.plane_cells import find_plane_cells
from insertion.scene.point_cloud import ColouredPoints
from insertion.scene.supports import SupportSurfaces
from metric_base.arrays import FloatArray

#: Maximum side of a cell that may shade the sun, in heights of the cameras: a long street would have cells of metres.
SHADE_CELL = 0.6
#: Minimum number of points of such a cell, so that stray points in the air cast no shadow.
MIN_SHADE_POINTS = 2


class LightModel:
    """Light of a scene, estimated from the images of the reconstruction.

    Parameters
    ----------
    scene : Scene
        The reconstruction.
    images : SceneImages
        Its images.
    supports : SupportSurfaces
        Support surfaces; they give the up direction and, outdoors, the ground.
    cloud : ColouredPoints
        Points that the lamps or the sun are fitted to.
    static : ColouredPoints, optional
        Points for the environment maps, without those on moving objects; `cloud` by default.
    """

    def __init__(
        self,
        scene: Scene,
        images: SceneImages,
        supports: SupportSurfaces,
        cloud: ColouredPoints,
        static: ColouredPoints | None = None,
    ) -> None:
        self._scene, self._images, self._supports = scene, images, supports
        self._cloud, self._static = cloud, cloud if static is None else static

    @cached_property
    def source(self) -> RoomLight | OutdoorLight | None:
        """Lamps of a room, or the sun and the sky; None if neither is determined.

        The fit takes 1 to 2 s, so it runs on first use.
        """
        up = self._supports.up.vector
        shows_sky = is_outdoors(self._cloud, self._images, up)
        if shows_sky or looks_down(self._images, up):
            ground = self._supports.ground(self._cloud)
            sun = None if ground is None else sun_direction(self._cloud, self._images, ground.plane)
            if shows_sky or sun is not None:
                if ground is None or sun is None:
                    return OutdoorLight(None)
                heights = camera_centres(self._scene.views) @ ground.plane.basis[2] - ground.plane.height
                max_cell = SHADE_CELL * max(float(np.median(heights)), 0.0)
                return OutdoorLight(sun, occupancy_of(self._cloud, max_cell, MIN_SHADE_POINTS))
        cells = find_plane_cells(self._cloud, camera_centres(self._scene.views))
        if not len(cells.positions):
            return None
        is_free = partial(is_visibly_free, cloud=self._cloud, images=self._images)
        return fit_room_light(cells, up, is_free, occupancy_of(self._cloud))

    def environment(self, position: FloatArray, height: float) -> Environment:
        """Return the environment map centred on an object.

        Parameters
        ----------
        position : (3,) ndarray of float
            Bottom centre of the object in the scene.
        height : float
            Height of the object, in scene units.
        """
        basis = level_basis(self._supports.up.vector)
        return environment_at(position, height, basis, self._static, self._images, self.source)
