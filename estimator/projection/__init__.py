"""Projection of points into views, and the points that each view sees."""

# Modules, their limits, and their tests in `tests/estimator/projection`:
# - cameras: Camera models of COLMAP: validation, projection with lens distortion, and rays of pixels. Limits:
#   MAX_SIDE_PX, MAX_PIXELS. Tests: test_cameras.py.
# - visibility: Determine which points of a cloud each view sees, and where they project. Limits: ROTATION_WEIGHT,
#   EXPECTED_POINTS_PER_CELL, CELLS_PER_SIDE_RANGE, DEPTH_TOLERANCE, MAX_SLANT_COTANGENT, DEPTH_IMAGE_WIDTH,
#   BLOCK_POINTS, MAX_DEPTH_POINTS. Tests: test_sights.py, test_strays.py.
