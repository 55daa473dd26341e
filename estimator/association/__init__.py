"""Which points and which masks show one object (paper section 4.1)."""

# Modules, their limits, and their tests in `tests/estimator/association`:
# - clustering: Agglomerative clustering of masks with cannot-link constraints: masks of one view never share a group.
#   Limits: MAX_TABLE_GROUPS, MIN_COMMON_POINTS, BLOCK_PAIRS. Tests: test_tracks.py.
# - mask_checks: Check instance masks: remove duplicates, and find masks of other images, wrong crops and masks that are
#   too large. Limits: DUPLICATE_IOU, IOU_ROUNDING, MIN_COVER, MIN_NAMES, MIN_VALID_COVER, MIN_VALID_NAMES, NO_COVER,
#   MIN_PAIRS, MIN_TRACK_AGREEMENT, MIN_VALID_TRACK_AGREEMENT, MIN_TRACKS, MIN_TRACK_PAIRS, MIN_POOLED_TRACKS,
#   RIM_FRACTION, MIN_RIM_PX, MAX_RIM_MASKS, MIN_RIM_OBSERVATIONS, MIN_RIM_AGREEMENT, MIN_RIM_RATIO, MAX_DEPTH_STEP,
#   MAX_DEPTH_CONTINUITY, MIN_OVERLAP, MAX_OVERLAPPING_FRACTION, MIN_STRAIGHT_FILL, MAX_STRAIGHT_FRACTION,
#   MIN_STRAIGHT_PX, MIN_MASKS. Tests: test_duplicates.py, test_mask_agreement.py, test_mask_rims.py.
# - mask_overlap: Count the points that pairs of masks have in common, among the points that both views see. Limits:
#   PSEUDOCOUNT_FRACTION, BLOCK_MASKS, BLOCK_COST, ROUNDING. Tests: test_mask_overlap.py.
# - point_labels: Label points with the masks that contain them, without the background behind the object (paper section
#   4.1). Limits: MAX_MASK_DEPTH_DIAGONALS, MAX_BOX_DEPTH_DIAGONALS, BOX_CENTRE_FRACTION, MIN_MASK_VOTE_FRACTION,
#   MIN_BOX_VOTE_FRACTION, MIN_SUPPORT_FRACTION, TIE_BREAK_PER_VOTE. Tests: test_mask_agreement.py,
#   test_mask_overlap.py, test_mask_rims.py, test_point_labels.py, test_tracks.py.
# - proximity: Distance between the points of two groups of masks: D of the paper's Algorithm 1 (section 4.1). Limits:
#   MAX_DISTANCE_FRACTION, MIN_DISTANCE, MAX_DISTANCE_POINTS, MIN_LARGER_POINTS, MIN_SMALLER_POINTS. Tests:
#   test_mask_overlap.py, test_proximity.py.
# - tracks: Associate the instance masks of one object across views (paper section 4.1, Algorithm 1). Limits:
#   MIN_JOIN_AFFINITY, MIN_JOIN_IOU, MIN_COMMON_FRACTION, MAX_MASK_POINTS. Tests: test_mask_overlap.py,
#   test_mask_rims.py, test_tracks.py.
