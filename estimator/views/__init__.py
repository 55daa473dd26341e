"""3-D views of an estimate: their content, as a glTF file, as an image, and in a window."""

# Modules, their limits, and their tests in `tests/estimator/views`:
# - glb: Export the 3-D view of an estimate as a binary glTF file, with a node for each box that contains its report.
#   Limits: FACE_ALPHA, PLANE_ALPHA, GAMMA. Tests: test_views.py.
# - raster: Draw the 3-D view of an estimate as an image, without a display or a graphics card: distant elements first.
#   Limits: WIDTH, HEIGHT, AZIMUTH_DEG, TILT_DEG, FILLED_FRACTION, EYE_DISTANCE, LABEL_MARGIN_PX. Tests: test_views.py.
# - scene_view: Content of a 3-D view of an estimate: points, cameras, boxes with sizes, support planes and the
#   vertical. Limits: MAX_POINTS, CAMERA_FRACTION, UP_FRACTION, OUTLIER_FRACTION. Tests: test_views.py.
# - window: Show the 3-D view of an estimate in an Open3D window; a click on a box shows its report. Limits: WIDTH,
#   HEIGHT, MAX_CLICK_PX, GAMMA. Tests: test_views.py.
