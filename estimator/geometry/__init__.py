"""Measure objects in scene units, from their points and masks (paper section 4.2)."""

# Modules, their limits, and their tests in `tests/estimator/geometry`:
# - box: Fit an upright box to the points of an object (paper section 4.2): outliers, footprint, extents and confidence.
#   Limits: MAX_OBJECT_POINTS, MIN_POINTS, POINTS_PER_CELL, MAX_CELLS, MIN_RELATIVE_DENSITY, MAX_CLUSTER_DISTANCE,
#   SMALL_CLUSTER_FRACTION, PAPER_NEIGHBOURS, PAPER_SIGMAS, PAPER_TREES, COARSE_DEG, FINE_DEG, MAX_FOOTPRINT_POINTS,
#   FOOTPRINT_TRIM, CLOSENESS_WEIGHT, ETA_GRID. Tests: test_box_fit_outlines.py, test_eta.py, test_extents.py,
#   test_outliers.py.
# - canonical_frame: Normalise a scene so that results do not depend on its axes, the order of its lists, or duplicates.
#   Limits: MAX_PAIRS, MIN_MEAN_DIRECTION. Tests: test_canonical_frame.py.
# - category_rules: Categories that stand on the floor, that hang, and that end at a level top, if the name determines
#   it. Tests: test_planes.py.
# - cuboid_fit: Fit an upright cuboid to the outlines of an object in all views, and to its few points. Limits:
#   CORNER_SLACK_FACTOR, INSIDE_HALF_WEIGHT_SIGMAS, OUTSIDE_HALF_WEIGHT_SIGMAS, FRONT_HALF_WEIGHT_SIGMAS,
#   BEHIND_HALF_WEIGHT_SIGMAS, HOLLOW_FRACTION, MAX_INDEPENDENT_POINTS, MAX_INDEPENDENT_VIEWS, CORNER, SIDE_SD,
#   CENTRE_SD, YAW_SD, START_LENGTH, START_WIDTH, MAX_STEPS, COST_TOLERANCE, DAMPING, MAX_DAMPING, MAX_PARAMETER_STEP,
#   MAX_BATCH_VIEWS, MIN_WORSE_COST. Tests: test_box_fit_outlines.py, test_cuboid_fit.py, test_outlined.py.
# - extents: Estimate where a cloud of surface points begins and ends along an axis: the extent rule of all methods.
#   Limits: TRIM_QUANTILE, EXTRAPOLATION, MAX_FADE, MIN_NOISE_OVERSHOOT, MAX_NOISE_OVERSHOOT, HALF_OVERSHOOT_RATIO,
#   MISSING_FRACTION, MAX_POINTS, RULE_SIGMA, SAMPLING_SIGMA, OUTLIER_SIGMA, FADE_SIGMA, TOP_WINDOW, MIN_TOP_HEIGHT,
#   MIN_TOP_FRACTION, MIN_TOP_POINTS, MIN_TOP_RATIO, TOP_QUANTILE, TOP_SIGMA, HIDDEN_TOP_SIGMA. Tests: test_extents.py.
# - mask_outlines: Outlines of instance masks: contours, the largest projections in eight directions, and which parts
#   are truncated. Limits: BOX_DIRECTIONS, EDGE_SIGMA_PX, EDGE_SIGMA_FRACTION, MASK_SIGMA_PX, MASK_SIGMA_FRACTION,
#   BORDER_PX, OCCLUDER_DISTANCE_PX, OCCLUDER_DISTANCE_FRACTION, OUTER_FRACTION, MIN_CUT_FRACTION. Tests:
#   test_box_fit_outlines.py, test_cuboid_fit.py, test_outlined.py, test_truncation.py.
# - measurement: Measure each track in scene units from its points and masks, and skip parts of other objects (paper
#   section 4.2). Limits: MIN_OBJECT_POINTS, BELOW_FLOOR_BINS, MIN_CLUTTER_FRACTION, INFERRED_VISIBILITY_SIGMA,
#   FOOTPRINT_SIGMA_FACTOR, MAX_SUPPORTED_TILT_DEG, ONE_VIEW_SIGMA, MIN_CONTAINED_FRACTION, CONTAINER_SCALE,
#   CONTAINMENT_GRID. Tests: test_fragments.py, test_measurement.py.
# - outline_measurement: Measure objects by the cuboid that fits their outlines: objects with boxes instead of masks, or
#   with few points. Limits: MIN_DENSE_POINTS, MIN_SUFFICIENT_POINTS, FEW_POINTS_SIGMA_FACTOR, MAX_SMEAR_FRACTION,
#   MIN_BOX_VIEWS, FIT_SIGMA_FACTOR, BOX_SIGMA, MASK_SIGMA, MIN_BOX_MISFIT, BOX_CENTRE_SD, FOOT_SIGMA_FRACTION,
#   PLANE_SIGMA_FRACTION, MIN_GROUND_POINTS, MAX_CONTACT_FRACTION, MAX_CONTACT_SIGMAS, BORDER_PX, MAX_SIGMA,
#   MAX_FIT_POINTS. Tests: test_outlined.py.
# - planes: Find the level surfaces of a cloud (floor, table tops, road) as peaks of the histogram of its heights.
#   Limits: HEIGHT_BINS, VOXELS_PER_DIAGONAL, MAX_POINTS, MIN_PEAK_TO_MEDIAN, SURROUNDING_BINS, HALF_THICKNESS_BINS,
#   SMOOTHING_BINS, MIN_PLANE_FRACTION, MIN_POINTS, MIN_BINS_APART, CELL_BINS, MAX_BELOW_FLOOR_FRACTION,
#   MAX_BELOW_GLOSSY_FLOOR_FRACTION, MIN_WIDE_FRACTION, NEAR_X. Tests: test_planes.py, test_up.py.
# - point_noise: Estimate the noise of clouds: depth noise of dense points, covariances of sparse points. Limits:
#   MAX_VIEWS, MAX_CELLS, POINTS_PER_CELL, MIN_POINTS_PER_CELL, MIN_CELLS, FLAT_CELL_QUANTILE, FLAT_CELL_RATIO,
#   MIN_KEYPOINT_SIGMA_PX, MAX_KEYPOINT_SIGMA_PX, RAYLEIGH_MEDIAN, MAX_OBSERVATIONS, MIN_POINT_SIGMA, MAX_POINT_SIGMA.
#   Tests: test_noise.py, test_outlined.py.
# - scene_geometry: Estimate the vertical, the support planes and the noise of a scene (`scene_geometry`).
# - support: Extend objects whose foot is not reconstructed down to the surface below them. Limits: RING_WIDTH_FRACTION,
#   MIN_RING_POINTS, MIN_RING_SECTORS, MIN_RING_LEVEL_FRACTION, WALL_FACTOR, MAX_CONTACT_FRACTION, MAX_UNOBSERVED_GAP,
#   MAX_OBSERVED_GAP, MIN_REACH_FRACTION, MAX_FLOOR_GAP, LEVEL_SIGMA_FRACTION, FILLED_SIGMA, MAX_SLAB_ASPECT,
#   MIN_SLAB_CLEARANCE. Tests: test_planes.py.
# - truncation: Find the truncated sides of an object: sides whose end no view shows, so that an extent may be too
#   small. Limits: MAX_OUTLINE_POINTS, MAX_OBJECT_POINTS, OUTER_FRACTION, BORDER_FRACTION, MIN_CUT_FRACTION,
#   MIN_VISIBLE_SINE, MIN_EXCESS_SINE, END_BAND, TOP_BAND, MIN_TOP_FRACTION, MIN_TOP_ASPECT, MIN_OCCLUDER_DISTANCE,
#   MIN_OCCLUDER_HEIGHT, MIN_COMPLETE_VIEWS, MIN_EXCESS_FRACTION. Tests: test_truncation.py.
# - vertical: Estimate the vertical of a scene from its cameras (paper section 4.2) and its level surfaces. Limits:
#   ROLL_DEG, FRAMES_PER_READING, OBSERVABLE_DEG, PITCH_DEG, MIN_MEAN_UP, MIN_DOWNWARD_COSINE, MAX_DOWNWARD_MEAN_UP,
#   MIN_FACED_FRACTION, GIVEN_DEG, MAX_TILT_SIGMAS, MAX_UP_ERROR_DEG, MAX_SEARCH_POINTS, FINE_BIN, SHARPNESS_POWER,
#   STEPS, MAX_FINE_DEG, TRIM_DENOMINATOR, KNOWN_AXIS_DEG, MIN_STEP_DEG, CAMERA_PRIOR_WEIGHT, FIT_ROUNDS, FIT_BIN,
#   MAX_SLOPE_DEG, MAX_CAMERA_DISTANCE2, MAX_CLOUD_ANGLE_DEG, POINTS_PER_READING, SLOPE_DEG, COMMON_DEG,
#   STREET_SLOPE_DEG. Tests: test_up.py.
