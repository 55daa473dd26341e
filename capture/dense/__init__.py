"""Dense points of a reconstruction on the CPU: depth by plane sweep, kept where several views agree."""

# Modules, their limits, and their tests in `tests/capture`:
# - fusion: Fuse the depth maps of several views into a dense cloud of the points that other views confirm. Limits:
#   MAX_VIEWS, N_SOURCES, BEST_ANGLE_DEG, ANGLE_SPREAD_DEG, MAX_DIFFERENCE, MIN_AGREEING, STRIDE, DEPTH_QUANTILES,
#   DEPTH_MARGINS, N_THREADS. Tests: test_dense.py.
# - patch_match: Compute dense points by COLMAP's PatchMatch on a CUDA device, or by the plane sweep on the CPU. Limits:
#   MAX_HELP_S. Tests: test_patch_match.py.
# - patch_match_worker: COLMAP's dense reconstruction in a separate process. Limits: DEPTH_SIDE, MIN_PIXELS.
# - plane_filling: Fill plain surfaces, which correlation leaves empty, with planes through the depths around them.
#   Limits: MAX_PLAIN_STD, WINDOW, MIN_AREA, MIN_BORDER, BORDER_WIDTH, TOLERANCE, MIN_OBJECT_STEP, MIN_ON_PLANE,
#   MAX_BEHIND, N_TRIALS. Tests: test_dense.py.
# - plane_sweep: Depth of a view by a plane sweep (Collins 1996), smoothed along four paths (Hirschmueller 2008).
#   Limits: DEPTH_SIDE, N_PLANES, WINDOW, N_BEST_SOURCES, SMALL_STEP, LARGE_STEP, MIN_CORRELATION, MIN_VARIANCE,
#   EDGE_RATIO. Tests: test_dense.py.
