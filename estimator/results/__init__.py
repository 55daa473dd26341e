"""From measured objects and a tree to a result: priors of the categories, scale, verdicts, advice."""

# Modules, their limits, and their tests in `tests/estimator/results`:
# - advice: Suggest the measurements that would narrow the interval most (`suggest_measurements`). Limits:
#   SUPPOSED_QUANTILES, MEASURED_SD_LOG, TAPE_SD_LOG, MIN_INLIER_PROBABILITY, MIN_NARROWING, MAX_SUGGESTIONS,
#   MAX_SKIPPED_CLASSES, MAX_TRUNCATED_OBJECTS. Tests: test_narrowing.py.
# - estimate: Estimate the scale from measured objects and other evidence (`scale_of_objects`). Limits: MIN_KEPT_WEIGHT,
#   MIN_TAIL_MASS, MIN_WRONG_LABEL_FRACTION, MIN_WRONG_LABELS, MIN_EVIDENCE_WEIGHT, MAX_OWN_RATIO, MAX_DISTANT_FRACTION,
#   MIN_MODEL_RATIO, MAX_AGREEING_RATIO, MIN_AGREEING_OBJECTS, MIN_AGREEING_FRACTION, MAX_UNIT_DEVIATION, MAX_CURVES.
#   Tests: test_categories.py, test_contradiction.py, test_hollows.py, test_narrowing.py, test_states.py.
# - object_priors: Combine measured objects with the priors of their categories (`object_evidence`). Limits:
#   BROADER_SCORE, MIN_SCORED_POINTS, MAX_ADVISED_NAMES, MAX_COUNT_PER_CLASS, UNKNOWN_TYPE_PROBABILITY,
#   PROBABILITY_STEP, MIN_CLASSES, STATE_PROBABILITY. Tests: test_categories.py, test_hollows.py, test_narrowing.py,
#   test_places.py, test_states.py.
# - scale_report: Build the result of a method (`build_result`): a report for each object, its verdict and reason, and
#   the warnings. Limits: MIN_OBJECT_WEIGHT, TYPICAL_LEVEL, MIN_WARNED_OUTLIERS, MIN_WARNED_OUTLIER_FRACTION,
#   MAX_NAME_CHARS. Tests: ../records/test_result.py.
