"""Sources of evidence for the scale other than objects, for `estimate_scale(..., evidence=...)`.

>>> from estimator.evidence import CameraHeight
>>> CameraHeight.of("1.5+-0.15")
CameraHeight(metres=1.5, sd=0.15)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from metric_base.lazy_names import lazy_names

if TYPE_CHECKING:
    from estimator.evidence.camera_height import CameraHeight as CameraHeight
    from estimator.evidence.depth_maps import MetricDepth as MetricDepth
    from estimator.evidence.gps import Gps as Gps
    from estimator.evidence.gps import VideoGps as VideoGps
    from estimator.evidence.imu import Imu as Imu
    from estimator.evidence.known_lengths import KnownLength as KnownLength
    from estimator.evidence.markers import Marker as Marker
    from estimator.evidence.rig_baseline import RigBaseline as RigBaseline
    from estimator.evidence.source import EvidenceSource as EvidenceSource

#: Module of each public name, imported on first use, so that `--objects` does not import SciPy.
__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "camera_height": ("CameraHeight",),
        "depth_maps": ("MetricDepth",),
        "gps": ("Gps", "VideoGps"),
        "imu": ("Imu",),
        "known_lengths": ("KnownLength",),
        "markers": ("Marker",),
        "rig_baseline": ("RigBaseline",),
        "source": ("EvidenceSource",),
    },
)

# Modules, their limits, and their tests in `tests/estimator/evidence`:
# - alignment: Robust similarity between two sets of matched points. Limits: N_SAMPLES, SEED, SAMPLE_BATCHES,
#   MAX_INLIER_RESIDUALS, MIN_INLIER_EXTENT. Tests: test_evidence_formulas.py, test_motion.py, test_positions.py.
# - camera_height: The height of the camera above the floor, which is typical of hand-held cameras, tripods and cars.
#   Limits: MIN_HEIGHT_M, MAX_HEIGHT_M, DEFAULT_LOG_SD, MIN_LOG_SD, MAX_BELOW_FRACTION. Tests: test_camera_height.py,
#   test_evidence.py.
# - depth_maps: Estimate the scale from metric depth maps of a network, compared with the depths of the reconstruction.
#   Limits: FRAME_SD, FRAME_PRIOR_COUNT, MIN_POINTS, MAX_POINTS. Tests: test_depth_and_rigs.py, test_evidence.py,
#   test_evidence_formulas.py.
# - gps: Estimate the scale from positions of the cameras in metres: GPS of images (EXIF) or of a video, or a table.
#   Limits: MAX_GAP_S, MAX_SPEED_M_S, MIN_COVERED_FRACTION, SPEED_LAG_S, MAX_LOG_SD, MAX_COORDINATE, EARTH_RADIUS_M,
#   MAX_GEOCENTRIC_DEVIATION, MAX_LOCAL_M, POLE_DEG, MIN_STRETCH, MAX_STRETCHED_RESIDUAL, MIN_DIRECTION_EXTENT, LAT_REF,
#   LAT, LON_REF, LON, ALT_REF, ALT, DILUTION, POSITIONING_ERROR, TYPICAL_ACCURACY_M, DRIFT_FRACTION, END_TO_END,
#   N_PROBED_IMAGES, MIN_POSITIONS, MIN_EXTENT_RESIDUALS, MIN_LOG_SD. Tests: test_evidence.py,
#   test_evidence_formulas.py, test_motion.py, test_positions.py.
# - imu: Estimate the scale from an inertial unit: its path, integrated from accelerations, against the path of the
#   camera. Limits: WINDOW_S, MIN_WINDOW_S, SECONDS_PER_DEGREE, MAX_GAP_S, MAX_OFFSET_S, OFFSET_STEP_S, GRAVITY,
#   MIN_GRAVITY, MAX_GRAVITY, MAX_READING_G, MIN_RATE_HZ, MIN_SWING_RMS_M, MIN_PATH_CORRELATION, WINDOW_PARTS,
#   MIN_LOG_SD, MIN_PATH_RESIDUALS. Tests: test_evidence_formulas.py, test_motion.py.
# - known_lengths: Known lengths that the user measured: between two points, of an object, or between the middles of two
#   objects. Limits: DEFAULT_SIGMA, MIN_METRES, MAX_METRES, MIDDLE_ERROR. Tests:
#   ../reconstructions/test_known_lengths.py, ../results/test_narrowing.py, ../test_documented_forms.py.
# - markers: Estimate the scale from printed markers of known size in the images: ArUco, AprilTag, and ChArUco boards.
#   Limits: CROP_MARGIN, MIN_CROP_MARGIN_PX, MIN_CROP_SIDE_PX, MAX_CROP_SIDE_PX, MAX_CORNER_MOVE, MIN_VIEWS,
#   MIN_CORNERS, MIN_RAY_ANGLE, MAX_SQUARES, MIN_LOG_SD, MAX_LOG_SD, MAX_REPROJECTION_ERROR. Tests: test_evidence.py,
#   test_evidence_formulas.py, test_markers.py, test_positions.py.
# - rig_baseline: Estimate the scale from the known distance between the cameras of a rig, such as a stereo pair.
#   Limits: MIN_LOG_SD, MIN_RELATIVE_DISTANCE. Tests: test_depth_and_rigs.py, test_evidence.py.
# - source: The protocol of evidence sources, and the path of a camera over time for evidence with times. Tests:
#   test_evidence.py, test_evidence_formulas.py, test_motion.py.
