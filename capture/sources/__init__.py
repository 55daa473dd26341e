"""Inputs of a capture: videos and image folders, the choice of frames, and the metadata of the lens."""

# Modules, their limits, and their tests in `tests/capture`:
# - frame_selection: Choose frames of a video evenly along the motion of the camera, the sharpest one of each stretch.
#   Limits: DEFAULT_FRAMES, MAX_STEP, MAX_FRAMES, MIN_STEP, MIN_FRAMES, MOTION_SIDE, N_CORNERS, MIN_CORNERS, EDGE_SIDE,
#   MIN_EDGE_LEVELS, EDGE_WINDOW, N_DIRECTIONS, MIN_EDGES. Tests: test_frame_choice.py.
# - frames: Choose the frames to reconstruct from and write them upright to `frames/`, with `frames.json` about them.
#   Limits: MAX_SIDE, JPEG_QUALITY, MIN_READ_FRACTION, MIN_IMAGES. Tests: test_instances_file.py, test_pictures.py,
#   test_refusals.py, test_values_of_limits.py, test_video.py.
# - image_folder: Read a folder of images as frames: upright, in the order of their names, with the focal length of
#   EXIF. Tests: test_pictures.py.
# - lens_metadata: Read the lens from the metadata of a video: a phone's focal length, an action camera's field of view.
#   Limits: MAX_CONTENTS_BYTES, FISHEYE_RANGE_DEG. Tests: test_quicktime.py.
# - video: Decode a video: upright RGB frames with their presentation times, tone-mapped if it is HDR. Limits:
#   MAX_PIXELS, MAX_ASPECT, WIDTH_35MM, N_THREADS, WHITE_PQ, WHITE_HLG. Tests: test_frame_poses.py, test_pictures.py,
#   test_quicktime.py, test_video.py.
