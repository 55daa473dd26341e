"""Estimate the vertical, the support planes and the noise of a scene (`scene_geometry`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from estimator.association.point_labels import PointLabels
from estimator.geometry.planes import floor_of, level_basis, support_planes, voxel_downsample
from estimator.geometry.point_noise import depth_noise
from estimator.geometry.support import SupportCloud
from estimator.geometry.vertical import camera_up, refine_up, up_problems
from estimator.records.objects import SupportPlane, Up
from estimator.records.options import MeasurementOptions
from estimator.records.scene import Scene, SceneProblem
from metric_base.arrays import FloatArray
from metric_base.progress import stopwatch


@dataclass(frozen=True, slots=True, eq=False)
class SceneGeometry:
    """Quantities of a scene that the measurement of every object needs."""

    up: Up
    basis: FloatArray  #: (3, 3) unit rows: two horizontal axes and up.
    planes: tuple[SupportPlane, ...]  #: Level surfaces, lowest first.
    floor: SupportPlane | None
    support_cloud: SupportCloud | None  #: None without points or if supports are not used.
    noise: tuple[float, ...]  #: Standard deviation of each cloud along the line of sight, relative to the distance.
    problems: tuple[SceneProblem, ...]  #: Contradictions between the given vertical and the scene.


def scene_geometry(
    scene: Scene,
    clouds: Sequence[PointLabels],
    options: MeasurementOptions,
    given: Up | None,
    seconds: dict[str, float],
) -> SceneGeometry:
    """Estimate the vertical, the support planes and the noise of a scene.

    Parameters
    ----------
    scene : Scene
    clouds : sequence of PointLabels
        Its clouds. The last one shows the surfaces.
    options : MeasurementOptions
        Its fields `planes_for_up` and `supports` are used.
    given : Up, optional
        Known vertical, which replaces the estimate.
    seconds : dict
        Receives the duration of each step.
    """
    with stopwatch(seconds, "up"):
        downsampled = [voxel_downsample(cloud.points) for cloud in clouds]
        up = camera_up(scene.views)
        if options.planes_for_up:
            up = refine_up(up, downsampled)
        problems = () if given is None else up_problems(given, up)
        up = given or up
        basis = level_basis(up.vector)
        planes: tuple[SupportPlane, ...] = ()
        floor, support_cloud = None, None
        if options.supports:
            planes = support_planes(up.vector, downsampled[-1])
            floor = floor_of(planes, clouds[-1].points)
            support_cloud = SupportCloud.from_points(downsampled[-1] @ basis.T, floor)
    with stopwatch(seconds, "noise"):
        noise = tuple(depth_noise(scene.views, cloud) for cloud in clouds)
    return SceneGeometry(up, basis, planes, floor, support_cloud, noise, problems)
