"""Read reconstructions of COLMAP and OpenSfM and dense clouds as a `Scene`, and check them."""

# Modules, their limits, and their tests in `tests/estimator/reconstructions`:
# - colmap: Read a COLMAP model as a scene: a folder of binary or text files, or a `pycolmap.Reconstruction` in memory.
#   Limits: MAX_QUATERNION_ERROR. Tests: test_colmap.py.
# - colmap_files: Parse the binary and text files of COLMAP (colmap/scene/reconstruction_io_binary.cc and
#   reconstruction_io_text.cc). Limits: MAX_EXACT.
# - image_files: Find the images of a scene: in and above the folder of its model, or in a folder that the user names.
#   Limits: MAX_LEVELS_UP. Tests: test_splats.py.
# - model_checks: Check a reconstruction: degenerate geometry, which determines no sizes, and contradictions to its
#   observations. Limits: MAX_OBSERVATIONS, MAX_GOOD_ERROR, MAX_ERROR, MAX_GOOD_MISSES, MAX_MISSES, MAX_GOOD_BEHIND,
#   MAX_BEHIND, MAX_DEPTH_RATIO, MIN_GROUP_VIEWS, MIN_DISTANCE_M, MAX_DISTANCE_M, MIN_LEVEL_HEIGHT_M,
#   MAX_LEVEL_HEIGHT_M, MAX_USUAL_HEIGHT_M, MAX_ASSUMED_HEIGHT_M, MAX_LEVEL_SINE, MAX_FOCAL_RATIO, N_PROBED_IMAGES,
#   MIN_BASELINE_RATIO, MIN_THICKNESS_RATIO, MAX_OUTLIER_DISTANCES, MIN_POINTS, MAX_SHAPE_POINTS. Tests:
#   test_consistency.py, test_degeneracy.py.
# - objects_file: Read measured objects of other programs: `metric-tree/objects/1` (docs/reference/formats.md, option
#   `--objects`). Limits: DEFAULT_SIGMA, MAX_OBJECTS, MIN_LENGTH, MAX_LENGTH. Tests: test_objects_file.py.
# - opensfm: Read OpenSfM datasets as a scene: `reconstruction.json` and `tracks.csv` (opensfm/io.py and
#   opensfm/features.py). Tests: test_opensfm.py.
# - ply: Read dense clouds: PLY files with any scalar properties, and the visibility lists of COLMAP. Limits:
#   MAX_INT16_VIEWS. Tests: test_ply.py, test_splats.py.
# - pycolmap_library: Import pycolmap without its side effects. Tests: ../projection/test_cameras.py.
# - scene_reader: Find and read a reconstruction in any supported format, and join its dense cloud. Limits:
#   MAX_FOLDERS_ABOVE_SPLAT, MIN_NEAR_FRACTION, MAX_GAUSSIAN_DISTANCE, MAX_COMPARED_GAUSSIANS, MIN_SEEN_FRACTION,
#   MAX_LOG_EXTENT_ERROR, MIN_UNIT_DIFFERENCE, MAX_CHECKED_POINTS, MIN_IN_VIEW_FRACTION, MAX_DISTANCE_FACTOR,
#   SPARSE_TAIL_FRACTION. Tests: test_colmap.py, test_damaged.py, test_opensfm.py, test_ply.py, test_splats.py.
# - splats: Read the centres of Gaussian splats, and scale splats: PLY of 3DGS, compressed PLY of SuperSplat, and SPZ.
#   Limits: MIN_OPACITY, CHUNK, MAX_SPZ_POINTS. Tests: test_splats.py.
