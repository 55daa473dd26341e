"""Baselines for comparison: the method of the paper, and that of Sucar and Hayet."""

# Modules, their limits, and their tests in `tests/estimator/baselines`:
# - candidate_search: Search of both baselines: the candidate scale with the highest product of likelihoods. Limits:
#   CANDIDATES, MARGIN. Tests: test_baselines.py.
# - paper: The estimate of the paper (section 4.3): s* = argmax of the product of phi_i(s L_i) over candidate scales.
#   Limits: ITEMS_PER_COMPONENT, MAX_ITEMS, MIN_ITEMS, MIN_RELATIVE_SD, MM_PER_INCH, SEED. Tests: test_baselines.py.
# - sucar: The estimate of Sucar and Hayet: heights of back-projected detection boxes and a prior of the height of each
#   class. Limits: MIN_POINTS, N_SAMPLES, SEED. Tests: test_baselines.py.
