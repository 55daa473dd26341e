"""Compute the poses of the frames between the reconstructed ones from tracked points of the model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from capture.frame_poses import FramePose
from capture.mapping.pose_refinement import refined_pose, residuals_px
from capture.sources.video import VideoFrame
from estimator.projection.cameras import view_rays
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray, IntArray

Grey = NDArray[np.uint8]
#: Points of the model (k,) by index with their pixels (k, 2) in an image.
Tracks = tuple[IntArray, FloatArray]

#: Longer side in pixels of the images in which points are tracked; tracks are good to a tenth of a pixel.
TRACKED_SIDE = 800
#: Maximum number of points tracked from a reconstructed frame; 400 good to half a pixel give a pose good to 0.05 px.
MAX_POINTS = 400
#: Maximum number of frames in memory between two reconstructed ones.
MAX_WAITING = 200
#: Minimum distance of tracked points from the border in pixels, and maximum mean difference of grey levels of the
#: window about them; beyond, the track is lost.
BORDER_PX, MAX_GREY_DIFFERENCE = 4, 20.0
#: One of so many points is not used for the pose but checks it.
CHECKED_EVERY, MIN_CHECKED = 5, 5
#: Minimum number of points for a pose, and residual in pixels of those that agree with it.
MIN_POINTS, MAX_RESIDUAL_PX = 20, 3.0
#: Maximum median residual of the checked points, relative to the longer side.
MAX_CHECK = 0.004
#: Maximum time between poses that are interpolated.
MAX_GAP_S = 1.0


def localised_frames(
    frames: Iterable[VideoFrame], scene: Scene, names: dict[int, str], source_width: int
) -> Iterator[FramePose]:
    """Yield a pose for each frame, in order.

    Parameters
    ----------
    frames : iterable of VideoFrame
    scene : Scene
        The reconstruction.
    names : dict of int to str
        File in `frames/` of each chosen frame, by index.
    source_width : int
        Width in pixels of the frames, in which errors are given.
    """
    views = {view.name: view for view in scene.views}
    tracker = FrameTracker(scene, source_width)
    waiting: list[tuple[FramePose, Grey]] = []
    before: tuple[FramePose, Grey, Tracks] | None = None
    for frame in frames:
        grey = np.asarray(cv2.cvtColor(frame.colour, cv2.COLOR_RGB2GRAY))
        factor = TRACKED_SIDE / max(grey.shape)
        if factor < 1:
            size = (round(grey.shape[1] * factor), round(grey.shape[0] * factor))
            grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA))
        name = names.get(frame.index)
        view = views.get(name or "")
        if view is not None:
            anchor = tracker.anchor(view, frame, grey)
            yield from tracker.between(waiting, before, anchor)
            yield anchor[0]
            waiting, before = [], anchor
            continue
        waiting.append((FramePose(frame.index, frame.time_s, name, "none"), grey))
        if len(waiting) == MAX_WAITING:  # too far from a reconstructed frame for the frames that follow
            yield from tracker.between(waiting, before, None)
            waiting, before = [], None
    yield from tracker.between(waiting, before, None)


class FrameTracker:
    """Tracks points of a scene from reconstructed frames (pose, image, tracks) into others."""

    def __init__(self, scene: Scene, source_width: int) -> None:
        self._points, self._camera = scene.points, scene.views[0].camera
        self._source_px = source_width / self._camera.width

    def anchor(self, view: View, frame: VideoFrame, grey: Grey) -> tuple[FramePose, Grey, Tracks]:
        """Return the pose of a reconstructed frame, its image (h, w), and points that it observes, evenly chosen."""
        count = min(len(view.point_index), MAX_POINTS)
        chosen = np.unique(np.linspace(0, len(view.point_index) - 1, count).astype(int))
        pixels = view.keypoints[chosen] * (grey.shape[1] / view.camera.width) - 0.5  # OpenCV's centres are integers
        rays = view_rays(view.camera, view.keypoints)[:, :2]
        place = view.rotation, view.translation
        check = self._check(self._points[view.point_index], rays, *place)
        pose = FramePose(frame.index, frame.time_s, view.name, "reconstructed", *place, check, len(rays))
        return pose, grey, (view.point_index[chosen], pixels)

    def between(
        self,
        waiting: list[tuple[FramePose, Grey]],
        before: tuple[FramePose, Grey, Tracks] | None,
        after: tuple[FramePose, Grey, Tracks] | None,
    ) -> list[FramePose]:
        """Return the poses of frames, images (h, w), between two reconstructed ones, either of which may be missing."""
        tracks: list[list[Tracks]] = [[] for _ in waiting]
        for anchor, order in ((before, range(len(waiting))), (after, range(len(waiting) - 1, -1, -1))):
            if anchor is not None:
                found = self._track(anchor[1], anchor[2], [waiting[k][1] for k in order])
                for k, tracked in zip(order, found, strict=False):
                    tracks[k].append(tracked)
        # frames before the first reconstructed one are reached from it, backwards
        guess = before or after
        order = range(len(waiting)) if before is not None else range(len(waiting) - 1, -1, -1)
        poses = [pose for pose, _ in waiting]
        seen: list[tuple[IntArray, FloatArray] | None] = [None] * len(waiting)
        last = None if guess is None else guess[0]
        for k in order:
            if tracks[k] and last is not None:
                rows = np.concatenate([index for index, _ in tracks[k]])
                pixels = np.concatenate([places for _, places in tracks[k]]) + 0.5
                rays = view_rays(self._camera, pixels * (self._camera.width / waiting[k][1].shape[1]))[:, :2]
                valid = np.isfinite(rays).all(axis=1)  # a strong distortion cannot be inverted at every pixel
                rows, rays = rows[valid], rays[valid]
                seen[k] = rows, rays
                poses[k] = self._pose(poses[k], rows, rays, last)
                last = poses[k] if poses[k].origin == "localised" else last
        known = [anchor[0] for anchor in (before, after) if anchor is not None]
        known = sorted([*known, *(pose for pose in poses if pose.origin != "none")], key=lambda pose: pose.index)
        return [self.interpolated(pose, known, seen[k]) for k, pose in enumerate(poses)]

    def _track(self, start: Grey, tracks: Tracks, images: list[Grey]) -> Iterator[Tracks]:
        """Yield the tracks in each image (h, w), always found from the start image, so that they do not drift."""
        rows, first = tracks[0], tracks[1].astype(np.float32)
        pixels = first.copy()
        for grey in images:
            if len(rows) < MIN_POINTS:
                return
            pixels, found, difference = cv2.calcOpticalFlowPyrLK(
                start, grey, first, pixels.copy(), winSize=(21, 21), maxLevel=3, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
            )
            height, width = grey.shape
            inside = ((pixels >= BORDER_PX) & (pixels < (width - BORDER_PX, height - BORDER_PX))).all(axis=1)
            keep = (found[:, 0] == 1) & inside & (difference[:, 0] < MAX_GREY_DIFFERENCE)
            rows, first, pixels = rows[keep], first[keep], pixels[keep]
            yield rows, pixels.astype(np.float64)

    def _pose(self, pose: FramePose, rows: IntArray, rays: FloatArray, guess: FramePose) -> FramePose:
        """Return the pose fitted to tracked points (n,) with rays (n, 2); unchanged if too few of them agree."""
        is_checked = rows % CHECKED_EVERY == 0
        assert guess.rotation is not None  # a reconstructed or localised frame
        assert guess.translation is not None
        if (~is_checked).sum() < MIN_POINTS:
            return pose
        points, focal = self._points[rows], self._camera.focal_px
        used, used_rays = points[~is_checked], rays[~is_checked]
        rotation, translation = refined_pose(used, used_rays, guess.rotation, guess.translation, focal)
        n_points = int((residuals_px(used, used_rays, rotation, translation, focal) < MAX_RESIDUAL_PX).sum())
        if is_checked.sum() >= MIN_CHECKED:
            points, rays = points[is_checked], rays[is_checked]
        check = self._check(points, rays, rotation, translation)
        limit = MAX_CHECK * max(self._camera.width, self._camera.height) * self._source_px
        if n_points < MIN_POINTS or check is None or not check <= limit:
            return pose
        return FramePose(pose.index, pose.time_s, pose.name, "localised", rotation, translation, check, n_points)

    def _check(
        self, points: FloatArray, rays: FloatArray, rotation: FloatArray, translation: FloatArray
    ) -> float | None:
        """Return the median residual in pixels of the source of points (n, 3) with rays (n, 2).

        Rays outside the range of the lens model are ignored. None without points, or if most are behind the camera.
        """
        error = residuals_px(points, rays, rotation, translation, self._camera.focal_px)
        error = error[~np.isnan(error)]
        median = float(np.median(error)) if len(error) else np.inf
        return median * self._source_px if np.isfinite(median) else None

    def interpolated(
        self, pose: FramePose, known: list[FramePose], seen: tuple[IntArray, FloatArray] | None
    ) -> FramePose:
        """Return an unknown pose interpolated between known ones, checked by points (n,) with rays (n, 2)."""
        earlier = [other for other in known if other.index < pose.index]
        later = [other for other in known if other.index > pose.index]
        if pose.origin != "none" or not earlier or not later:
            return pose
        ends = earlier[-1], later[0]
        start, end, time_s = ends[0].time_s, ends[1].time_s, pose.time_s
        if start is None or end is None or time_s is None or end - start > MAX_GAP_S:
            return pose
        ratio = (time_s - start) / (end - start)
        turns = Rotation.from_matrix(np.array([other.rotation for other in ends]))
        rotation = Slerp([0.0, 1.0], turns)(ratio).as_matrix()
        translation = -rotation @ ((1 - ratio) * np.asarray(ends[0].centre) + ratio * np.asarray(ends[1].centre))
        check = None if seen is None else self._check(self._points[seen[0]], seen[1], rotation, translation)
        return FramePose(pose.index, pose.time_s, pose.name, "interpolated", rotation, translation, check)
