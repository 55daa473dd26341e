"""The poses of the frames between the reconstructed ones, from points of the model that are tracked into them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from capture.frame_poses import FramePose
from capture.mapping.pose_refinement import PosePoints, rays_of, refined_pose, residuals_px
from capture.sources.video import VideoFrame
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray, IntArray

Grey = NDArray[np.uint8]

#: Longer side of the pictures that points are tracked in; tracks are good to a tenth of its pixels.
SIDE = 800
#: Points tracked from a reconstructed frame; a pose from 400 good to half a pixel is itself good to 0.05 px.
POINTS = 400
#: Frames held in memory between two reconstructed ones.
HELD = 200
#: Every so many points are kept out of the pose, to check it.
HELD_OUT = 5
#: Fewest points that a pose rests on, and largest check, as a share of the longer side, with which it is believed.
LEAST_POINTS, LARGEST_CHECK = 20, 0.004
#: Between frames further apart in time nothing is interpolated.
LONGEST_GAP_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class _Anchor:
    """A reconstructed frame that points are tracked from: its grey picture, the points' rows and pixels there."""

    grey: Grey
    rows: IntArray
    pixels: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class _Held:
    """A frame that waits for its pose."""

    index: int
    time_s: float
    grey: Grey


def localised_frames(
    frames: Iterable[VideoFrame], scene: Scene, names: dict[int, str], source_width: int
) -> Iterator[FramePose]:
    """One pose for each frame, in order.

    scene : the reconstruction; names : file in `frames/` of each chosen frame by index; source_width : width in pixels
    of the frames as they come, which checks are stated in.
    """
    views = {view.name: view for view in scene.views}
    tracker = _Tracker(scene, source_width)
    waiting: list[_Held] = []
    before: _Anchor | None = None
    last: FramePose | None = None
    for frame in frames:
        grey = _grey(frame.colour)
        view = views.get(names.get(frame.index, ""))
        if view is None:
            waiting.append(_Held(frame.index, frame.time_s, grey))
            if len(waiting) < HELD:
                continue
            poses = tracker.between(waiting, before, None, last)
            waiting, before = [], None  # too far from a reconstructed frame: what follows has none behind it
        else:
            anchor = tracker.anchor(view, grey)
            this = tracker.model_pose(view, frame)
            poses = [*tracker.between(waiting, before, anchor, last, this), this]
            waiting, before, last = [], anchor, this
        yield from (_with_name(pose, names) for pose in poses)
    yield from (_with_name(pose, names) for pose in tracker.between(waiting, before, None, last))


def _with_name(pose: FramePose, names: dict[int, str]) -> FramePose:
    return replace(pose, name=names.get(pose.index))


class _Tracker:
    def __init__(self, scene: Scene, source_width: int) -> None:
        self._scene = scene
        self._camera = scene.views[0].camera
        self._source_px = source_width / self._camera.width

    def anchor(self, view: View, grey: Grey) -> _Anchor:
        """The points that a reconstructed frame (h, w) observes, at most POINTS of them, evenly over the list."""
        chosen = np.unique(np.linspace(0, len(view.point_index) - 1, min(len(view.point_index), POINTS)).astype(int))
        pixels = view.keypoints[chosen] * (grey.shape[1] / view.camera.width) - 0.5  # OpenCV's centres are whole
        return _Anchor(grey, view.point_index[chosen], pixels.astype(np.float32))

    def model_pose(self, view: View, frame: VideoFrame) -> FramePose:
        """The pose of the model, checked by the frame's own observations."""
        points = PosePoints(self._scene.points[view.point_index], rays_of(view.camera, view.keypoints))
        error = residuals_px(points, view.rotation, view.translation, view.camera.params[0])
        check = float(np.median(error)) * self._source_px if len(error) else None
        return FramePose(
            frame.index, frame.time_s, view.name, "reconstructed", view.rotation, view.translation, check, len(error)
        )

    def between(
        self,
        held: list[_Held],
        before: _Anchor | None,
        after: _Anchor | None,
        first: FramePose | None,
        last: FramePose | None = None,
    ) -> list[FramePose]:
        """Poses of the frames between two reconstructed ones, either of which may be missing."""
        if not held:
            return []
        rows: list[list[IntArray]] = [[] for _ in held]
        pixels: list[list[FloatArray]] = [[] for _ in held]
        for anchor, order in ((before, range(len(held))), (after, range(len(held) - 1, -1, -1))):
            for k, (some, places) in zip(order, self._track(anchor, [held[k] for k in order]), strict=False):
                rows[k].append(some)
                pixels[k].append(places)
        points = [self._points(rows[k], pixels[k], held[k].grey) for k in range(len(held))]
        poses: list[FramePose] = []
        # frames before the first reconstructed one are reached from it, backwards
        order = range(len(held)) if first is not None else range(len(held) - 1, -1, -1)
        guess = first or last
        for k in order:
            pose = self._pose(held[k], points[k], guess)
            poses.append(pose)
            guess = pose if pose.origin == "localised" else guess
        poses = poses if first is not None else poses[::-1]
        return self._fill_gaps(poses, points, first, last)

    def _track(self, anchor: _Anchor | None, held: list[_Held]) -> Iterator[tuple[IntArray, FloatArray]]:
        """Rows (k,) and pixels (k, 2) of the anchor's points in each frame, always from the anchor itself: no drift."""
        import cv2

        if anchor is None or not len(anchor.rows):
            return
        rows, start, place = anchor.rows, anchor.pixels, anchor.pixels.copy()
        for frame in held:
            if len(rows) < LEAST_POINTS:
                return
            place, good, error = cv2.calcOpticalFlowPyrLK(
                anchor.grey, frame.grey, start, place.copy(), winSize=(21, 21), maxLevel=3,
                flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            )  # fmt: skip
            height, width = frame.grey.shape
            inside = ((place >= 4) & (place < (width - 4, height - 4))).all(axis=1)
            # the mean difference of grey levels over the window: past 20 it is another place
            kept = (good[:, 0] == 1) & inside & (error[:, 0] < 20)
            rows, start, place = rows[kept], start[kept], place[kept]
            yield rows, place.astype(np.float64)

    def _points(self, rows: list[IntArray], pixels: list[FloatArray], grey: Grey) -> tuple[IntArray, PosePoints] | None:
        """Rows (k,) of the scene's points that a frame (h, w) shows, and the points with their rays; None without."""
        if not rows:
            return None
        row = np.concatenate(rows)
        places = (np.concatenate(pixels) + 0.5) * (self._camera.width / grey.shape[1])
        return row, PosePoints(self._scene.points[row], rays_of(self._camera, places))

    def _pose(self, held: _Held, points: tuple[IntArray, PosePoints] | None, guess: FramePose | None) -> FramePose:
        """The pose of a frame by its tracked points, rows (n,) and the points themselves, from a guess.

        Its origin is `none` where the points are too few, or too far from their projections.
        """
        none = FramePose(held.index, held.time_s, None, "none")
        if points is None or guess is None or guess.rotation is None or guess.translation is None:
            return none
        row, tracked = points
        out = row % HELD_OUT == 0
        if (~out).sum() < LEAST_POINTS:
            return none
        focal = self._camera.focal_px
        rotation, translation, agreeing = refined_pose(tracked.some(~out), guess.rotation, guess.translation, focal)
        check = self._check(tracked.some(out) if out.sum() >= 5 else tracked, rotation, translation)
        limit = LARGEST_CHECK * max(self._camera.width, self._camera.height) * self._source_px
        if agreeing < LEAST_POINTS or not check <= limit:
            return none
        return replace(
            none, origin="localised", rotation=rotation, translation=translation, check_px=check, n_points=agreeing
        )

    def _check(self, points: PosePoints, rotation: FloatArray, translation: FloatArray) -> float:
        """Median reprojection error, source pixels, of a pose: rotation (3, 3), translation (3,)."""
        error = residuals_px(points, rotation, translation, self._camera.focal_px)
        return float(np.median(error)) * self._source_px if len(error) else float("nan")

    def _fill_gaps(
        self,
        poses: list[FramePose],
        points: list[tuple[IntArray, PosePoints] | None],
        first: FramePose | None,
        last: FramePose | None,
    ) -> list[FramePose]:
        """The poses with those that are missing interpolated between their neighbours in time, and checked.

        points : of each frame the rows (n,) and the points, None where it shows none.
        """
        known = [pose for pose in (first, *poses, last) if pose is not None and pose.rotation is not None]
        filled = []
        for pose, tracked in zip(poses, points, strict=True):
            earlier = [other for other in known if other.index < pose.index]
            later = [other for other in known if other.index > pose.index]
            if pose.origin != "none" or not earlier or not later:
                filled.append(pose)
                continue
            filled.append(self._interpolate(pose, earlier[-1], later[0], tracked))
        return filled

    def _interpolate(
        self, pose: FramePose, before: FramePose, after: FramePose, tracked: tuple[IntArray, PosePoints] | None
    ) -> FramePose:
        """The pose between two others by time, checked by its tracked points, rows (n,) and the points themselves."""
        from scipy.spatial.transform import Rotation, Slerp

        start, end, at = before.time_s, after.time_s, pose.time_s
        if start is None or end is None or at is None or end - start > LONGEST_GAP_S:
            return pose
        assert before.rotation is not None  # known poses only
        assert after.rotation is not None
        share = (at - start) / (end - start)
        turns = Rotation.from_matrix(np.stack([before.rotation, after.rotation]))
        rotation = Slerp([0.0, 1.0], turns)(share).as_matrix()
        centre = (1 - share) * np.asarray(before.centre) + share * np.asarray(after.centre)
        translation = -rotation @ centre
        check = None if tracked is None else self._check(tracked[1], rotation, translation)
        check = None if check is None or np.isnan(check) else check
        return replace(pose, origin="interpolated", rotation=rotation, translation=translation, check_px=check)


def _grey(colour: NDArray[np.uint8]) -> Grey:
    """(h, w) grey of a picture (h, w, 3)."""
    import cv2

    grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
    factor = SIDE / max(grey.shape)
    if factor < 1:
        size = (round(grey.shape[1] * factor), round(grey.shape[0] * factor))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(grey)
