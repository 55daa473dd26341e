"""Structure from motion: features, matches and a model of the chosen frames, or the reason why there is none."""

# Modules, their limits, and their tests in `tests/capture`:
# - camera_models: Choose the camera model of a reconstruction by the residuals of observations that the adjustment did
#   not see. Limits: MIN_TRACK_LENGTH, HELD_OUT_FRACTION, MAX_HELD_OUT_PX, MIN_GAIN_ERRORS. Tests:
#   test_camera_model_choice.py, test_disputes.py, test_incremental.py, test_refusals.py.
# - camera_prior: Knowledge about the camera before the mapping. Tests: test_disputes.py, test_incremental.py.
# - colmap_worker: Steps of the reconstruction with COLMAP, in a separate process, because an abort in C++ ends the
#   process. Limits: N_IMAGES_AT_ONCE, N_PAIRS_AT_ONCE, N_COMPARED_FEATURES. Tests: test_pycolmap_library.py.
# - covariance: Standard deviations of a model's focal length and of its camera steps, from the covariance of the
#   adjustment. Limits: MIN_STEP_RATIO. Tests: test_covariance.py.
# - features: Strategies of feature extraction and matching. Limits: N_THREADS. Tests: test_colmap_options.py,
#   test_pair_choice.py, test_refusals.py, test_strategies.py.
# - incremental: Compute a model from verified matches, in the worker process: map, register the remaining frames,
#   choose a lens. Limits: N_MAPPING_THREADS, MIN_POSE_INLIERS, MIN_SHARED_RATIO, MAX_PARTNERS, GUIDED_RATIO. Tests:
#   test_camera_model_choice.py, test_colmap_options.py, test_covariance.py, test_incremental.py, test_pair_choice.py,
#   test_triplets.py.
# - mapper: Map the frames from their verified matches, and accept or refuse the model with a report. Limits:
#   EXTRA_TIME_S. Tests: test_camera_model_choice.py, test_disputes.py, test_incremental.py, test_refusals.py,
#   test_strategies.py, test_values_of_limits.py.
# - match_graph: Graph of the frames of a capture, with an edge for each pair of frames that has enough verified
#   matches. Limits: MIN_LINK_INLIERS, MIN_TESTED_INLIERS, MIN_TESTED_MOTION, MAX_ROTATION_MISFIT. Tests:
#   test_refusals.py, test_values_of_limits.py.
# - model_metrics: Figures of a model by which it is judged: residuals, camera, and agreement with the matches. Limits:
#   N_GRID_CELLS, MIN_CELL_RESIDUALS. Tests: test_camera_model_choice.py.
# - pairs: Choose the pairs of frames to match: all of a few frames; of many, neighbours in order and candidates for a
#   loop. Limits: N_NEIGHBOURS, MAX_COMPARED, MIN_COMMON, MAX_LOOPS, MIN_LOOP_DISTANCE, MAX_UNORDERED, MAX_RATIO. Tests:
#   test_pair_choice.py.
# - pose_refinement: Fit the pose of a camera, and optionally its focal length, to points with a robust loss (Cauchy).
#   Limits: MAX_POSE_STEPS, N_WIDE_STEPS, WIDE_FACTOR, HALF_WEIGHT_PX, MIN_FOCAL_POINTS. Tests: test_focal_spread.py.
# - refusals: Refusals of captures: codes with advice, and the tests that refuse the frames or a model. Limits:
#   TYPICAL_FOCAL, MIN_FRAMES, MAX_STATIC_MOTION, MIN_KEYPOINTS, MIN_EDGE_STEEPNESS, MIN_ROTATION_RATIO,
#   MIN_PLACED_RATIO, MIN_WHOLE_RATIO, MAX_FOCAL_STD, MIN_ZOOM, MIN_ZOOM_ERRORS, MIN_WARNED_FOCAL_VARIATION,
#   MIN_WARNED_FOCAL_STD, FOCAL_ERROR_RATIO, MAX_BEND, MAX_ASPECT, MAX_MODEL_FOCAL_CHANGE, MIN_COMPARED_PATTERN,
#   MIN_WARNED_PATTERN, MAX_CONTRADICTED_RATIO, MIN_BROKEN_FRAMES, MAX_STEP_STD, MAX_DISAGREEMENT. Tests:
#   test_covariance.py, test_incremental.py, test_refusals.py, test_strategies.py, test_time_limit.py,
#   test_values_of_limits.py.
# - search: Search for a model of the frames: each strategy has its features, matches and mapping as stages. Limits:
#   MIN_QUICK_SIDE, MIN_QUICK_VIDEO_SIDE, POOLED_FEATURE_COST, POOLED_MATCH_COST, MAX_POOLED_S. Tests: test_refusals.py,
#   test_strategies.py.
# - triplets: Agreement of a model with the verified matches of three frames at a time, and the parts that they hold
#   together. Limits: MAX_RESIDUAL_PX, MAX_STRETCH, MAX_PART_RATIO, MIN_PARALLAX_PX, MIN_DEPTHS, REFERENCE_SIDE,
#   MIN_COMMON, MAX_COMMON, STEPS, N_STRONGEST. Tests: test_triplets.py.
# - worker: Run one step of the reconstruction in a worker process, within a time limit. Limits: MAX_TIME_S,
#   SECONDS_PER_FRAME, MAX_WALL_RATIO, MIN_FREE_BYTES. Tests: test_disputes.py, test_strategies.py, test_time_limit.py.
