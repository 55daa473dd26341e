"""Masks that a user draws on frames, and the instances file that they are written to."""

# Modules, their limits, and their tests in `tests/capture`:
# - drawing_page: Local page on which a person outlines and names the objects in a few frames; it works offline. Limits:
#   N_FRAMES, MAX_NAME_CHARS, N_OFFERED, MIN_SIDE_PX. Tests: test_mask_page.py.
# - instances_file: `instances.json` of a work folder: copied from a dataset, detected, or drawn. Tests:
#   test_instances_file.py.
