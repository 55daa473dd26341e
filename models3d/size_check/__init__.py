"""3-D models: the size that a file states, whether it is true, and the true size (docs/explanation/model-sizes.md)."""

# Modules, their limits, and their tests in `tests/models3d`:
# - category: Determine the category of a model from the texts of its file: title, nodes, meshes, file name, folder,
#   materials. Limits: OTHER_WEIGHT, REPEATED_FRACTION, DROPPED_WORD_FACTOR, MIN_VOTE_FRACTION, MIN_VOTE_WEIGHT,
#   MAX_TEXTS, MAX_TEXT_WORDS, MAX_TEXT_CHARS, MAX_LISTED. Tests: test_assets.py, test_verdict_limits.py.
# - check: Check whether the objects of a 3-D model file have their true size, or a wrong unit, scale or orientation.
#   Limits: MIN_WRONG, MIN_ROTATED, MIN_STRETCHED, MAX_OBJECTS, MIN_LISTED_PROBABILITY. Tests: test_assets.py,
#   test_readers.py, test_scale_for.py, test_verdict_limits.py.
# - hypotheses: Explain the extents of an object: hypotheses about its scale, with their posterior probabilities.
#   Limits: NAMED_MINIATURE, TOY_CHANCE, ARBITRARY_RANGE, NORMALISED_FRACTION, NORMALISED_M, NORMALISED_SD,
#   CENTRED_NORMALISED, CENTRED_OTHER, ROUND_FRACTION, ROUND_STEP, ROTATED_CHANCE, STRETCH_RANGE, UNLIKE_RANGE,
#   MIN_SIDE_M. Tests: test_assets.py, test_hypotheses.py.
# - omniverse_rule: Rule for NVIDIA's Asset Validator, which loads it from the entry point group `omni.asset_validator`.
# - report: HTML report of many models, sorted by the size of the error, with drawings to scale of the wrong ones.
#   Limits: PERSON_M, HEIGHT_PX, MARGIN_PX, COLUMN_PX, MIN_HEIGHT_FRACTION, MAX_DRAWINGS. Tests: test_verdict_limits.py.
# - scale_for: Estimate the scale of one object from its category and proportions, without a file or a scene. Limits:
#   DOUBT. Tests: test_scale_for.py.
# - size_model: Density of the extents of true-sized 3-D models of a category: the size prior, widened by the errors of
#   artists. Limits: ARTIST_COMMON_SD, ARTIST_SIDE_SD, UNLIKE_COMMON_SD, UNLIKE_SIDE_SD, UNLIKE_UNKNOWN, UNLIKE_BROADER.
#   Tests: test_assets.py, test_hypotheses.py.
# - true_size: Estimate the true size of a model from its proportions: the posterior of the factor on the size of its
#   file. Limits: LEVEL, N_GRID_POINTS, GRID_SIGMAS. Tests: test_assets.py, test_readers.py.
