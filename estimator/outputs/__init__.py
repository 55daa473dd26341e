"""Files that an estimate writes: figure, overlays, and the scene at metric scale."""

# Modules, their limits, and their tests in `tests/estimator/outputs`:
# - figure: Draw the figure of an estimate: the evidence of each object for the scale, and the positions of the objects.
#   Limits: MAX_ROWS, ROW_INCHES, HEAD_INCHES, FOOT_INCHES, MIN_INCHES, WIDTH_INCHES, MAX_LABEL_CHARS, AXIS_MARGIN,
#   AXIS_TAIL_FRACTION. Tests: test_figure.py.
# - ground_truth: Read `truth.json` of a scene, for figures that compare estimate and truth. Estimates do not use it.
#   Tests: test_ground_truth.py.
# - label_placement: Place labels close to their objects, so that they cover neither each other nor the objects. Tests:
#   test_placement.py.
# - overlay: Draw the boxes and sizes of objects on the images of a scene, as in the teaser of the paper. Limits:
#   AXIS_COLOURS, UNUSED, PLAIN, PANEL, PANEL_OPACITY, FONT_PX, MAX_HEADING_CHARS, MIN_WIDTH_PX. Tests: test_overlay.py.
# - plan: Draw plan and elevation of a scene: points, cameras and boxes of objects in metres, from above and from the
#   side. Limits: MAX_POINTS, MARGIN_FRACTION, CHARACTER_PX, LINE_PX, MAX_LABEL_CHARS. Tests: test_figure.py.
# - rescaled: Write the files of a scene at metric scale: all lengths times the scale, and everything else unchanged.
#   Tests: test_full_disk.py, test_rescaled.py.
# - size_labels: Format the sizes of an object for images and views: estimate, interval, and true size. Tests:
#   test_overlay.py.
