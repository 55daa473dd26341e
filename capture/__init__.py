"""A video or a folder of images to a reconstruction with the pose of every frame, in a work folder that resumes.

Packages: `sources` (frames of videos and folders, their choice), `mapping` (COLMAP: matches, models, refusals), `dense`
(depths and dense points), and `masks` (mask files, the page for drawing).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from metric_base.lazy_names import lazy_names

if TYPE_CHECKING:
    from capture.mapping.refusals import CaptureFailure as CaptureFailure
    from capture.pipeline import Capture as Capture
    from capture.pipeline import capture_video as capture_video

#: Module of each public name, imported on first use, so that light commands stay light.
__getattr__, __dir__, __all__ = lazy_names(
    __name__, {"pipeline": ("Capture", "capture_video"), "mapping.refusals": ("CaptureFailure",)}
)

# Modules, their limits, and their tests in `tests/capture`:
# - caution_files: The file of a work folder with the warnings about its reconstruction, which every result repeats.
#   Tests: test_capture.py, test_instances_file.py, test_refusals.py.
# - frame_poses: Pose of every frame of a capture, stored in `frame_poses.json` of the work folder. Tests:
#   test_capture.py, test_frame_poses.py.
# - localisation: Compute the poses of the frames between the reconstructed ones from tracked points of the model.
#   Limits: TRACKED_SIDE, MAX_POINTS, MAX_WAITING, BORDER_PX, MAX_GREY_DIFFERENCE, CHECKED_EVERY, MIN_CHECKED,
#   MIN_POINTS, MAX_RESIDUAL_PX, MAX_CHECK, MAX_GAP_S. Tests: test_frame_poses.py.
# - pipeline: Reconstruct a video or a folder of images into a work folder, stage by stage. Tests: test_time_limit.py,
#   test_values_of_limits.py.
# - quality_warnings: Warnings about a reconstruction, which `caution_files` stores in the work folder. Limits:
#   MAX_NAMED. Tests: test_refusals.py, test_values_of_limits.py.
# - recorded_sources: Evidence in the recording of a scene: positions and inertial data of its video, or positions in
#   EXIF data.
# - work_folder: Work folder of a capture: the outputs of each stage are complete or absent, with a stamp of their
#   inputs. Limits: VERSION, MAX_FREE_OF_FULL_DISK. Tests: test_capture.py, test_instances_file.py, test_strategies.py,
#   test_work_folder.py.
