"""Posterior of the scale from measured objects, size priors and other evidence (paper, section 4.3)."""

# Modules, their limits, and their tests in `tests/estimator/posterior`:
# - axis_assignments: Enumerate the assignments of the measured extents of an object to the axes of its prior, with
#   their errors. Limits: TRUNCATION_MIXTURE, GROSS_ERROR_PROBABILITY, GROSS_ERROR_SD_LOG, FREE_ORDER_WEIGHT. Tests:
#   test_likelihood.py.
# - class_hypotheses: Hypotheses about the similarity of the objects of one class in one scene, which the posterior
#   mixes. Limits: SIMILARITY_WEIGHTS, RELATED_FRACTION, ONE_KIND_FRACTION, MISLABEL_PROBABILITY,
#   MISLABEL_PROBABILITY_1D, MISLABEL_SD_LOG, BIAS_PROBABILITY, BIAS_FACTOR, FOOTPRINT_SD_LOG, MAX_KINDS,
#   VERTICAL_EXTENTS. Tests: test_posterior.py, test_sameness.py.
# - class_likelihood: Log likelihoods of classes over log scale: single objects in closed form, several objects over
#   their shared error. Limits: EFFECTIVE_OBJECTS, MAX_EVIDENCE_LOSS_LOG, MAX_ORIENTATION_OBJECTS, MIN_CLASS_POINTS,
#   MAX_CLASS_POINTS, MAX_KERNEL_STEP_SIGMAS, MAX_DEPTH_UNDER_PEAK_LOG, SEARCH_STRIDE, MAX_REDUCEAT_COLUMNS. Tests:
#   test_sameness.py.
# - log_scale_grid: Density of log scale on a grid: range and step of the grid, refinement, modes and interval. Limits:
#   PRIOR_MARGIN_LOG, SUPPORT_SIGMAS, MIN_OUTLIER_RATIO, MAX_STEP, MIN_STEP, STEP_SIGMAS, MIN_POINTS, MAX_POINTS,
#   FINE_POINTS_PER_STEP, MAX_REFINEMENT, MAX_DIP_WITHIN_MODE, MIN_MODE_MASS, MIN_PEAK_DENSITY. Tests:
#   test_posterior.py.
# - object_likelihood: Likelihood of one object: a mixture of Gaussians over v = u 1 - e, in log size. Limits:
#   OUTLIER_PROBABILITY, MIN_SCORE, MIN_PEAK_RATIO, MIN_GROSS_PEAK_RATIO, MAX_ORDER_SIGMAS, ROWS, COLUMNS,
#   INACTIVE_VARIANCE, BLOCK_OBJECTS. Tests: test_likelihood.py, test_posterior.py, test_sameness.py.
# - posterior: Compute the posterior of u = log scale from all evidence (paper 4.3), and its status: one mode or
#   competing modes. Limits: MAX_INTERVAL_RATIO, COMPETING_MODE_RATIO, MIN_COMPETING_MASS, MAX_COMPETING_MASS,
#   PEAK_WIDTH_RATIO, MIN_PEAK_MASS, MIN_MEAN_WEIGHT, MIN_JUDGED_OBJECTS, TEMPERING_EXPONENT, MAX_EDGE_MASS,
#   MIN_EVIDENCE_LOG_SD, MAX_OBJECTS_PER_CLASS, MIN_EVIDENCE_PROBABILITY. Tests: test_likelihood.py, test_posterior.py,
#   test_sameness.py.
# - shared_error: Integrate the product of the objects of a class over their shared error e ~ N(0, B). Limits:
#   NODE_PRECISION_FACTOR, N_ROW_ARRAYS. Tests: test_posterior.py, test_sameness.py.
