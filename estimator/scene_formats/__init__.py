"""Read reconstructions of other programs: nerfstudio, Bundler, Metashape, RealityCapture, Meshroom."""

# Modules, their limits, and their tests in `tests/estimator/scene_formats`:
# - bundler: Read `bundle.out` of Bundler (version 0.3), with the names of its images in `list.txt` or
#   `<bundle>.list.txt`.
# - common: Functions of several readers: lenses, views with poses, sizes of images, points, and parts of GLB files.
#   Limits: MAX_ROTATION_ERROR, MAX_FIT_ERROR, MAX_COEFFICIENT, N_FIT_ITERATIONS, MAX_TANGENT. Tests: test_networks.py,
#   test_other_programs.py.
# - depth_files: Read depth maps and point maps of networks: NumPy arrays and archives, EXR, PFM, and 16-bit PNG.
#   Limits: EXR_MAGIC, EXR_OTHER_LAYOUTS, MAX_PFM_HEADER, MAX_EXR_BYTES, MAX_PIXELS. Tests: test_depth_files.py,
#   test_photograph.py.
# - detection: Recognise the program of a reconstruction by the names and first bytes of its files.
# - dust3r: Read the GLB of DUSt3R, MASt3R and their descendants: a cloud, and the cameras from their drawings. Limits:
#   LONGER_SIDE, CORNERS.
# - gaussian_splatting: Read `cameras.json`, which the training program of 3D Gaussian Splatting writes next to its
#   splats.
# - meshroom: Read `.sfm` files of Meshroom and AliceVision (JSON): views, intrinsics, poses, and the structure with
#   observations. Limits: CENTRED_VERSION. Tests: test_other_programs.py.
# - metashape: Read cameras of Agisoft Metashape (File, Export, Export Cameras, Agisoft XML), with points in a PLY file.
#   Limits: MAX_SKEW, MAX_BYTES. Tests: test_other_programs.py.
# - nerfstudio: Read `transforms.json` of nerfstudio and instant-ngp: poses and cameras, with points in a PLY file.
#   Tests: test_other_programs.py.
# - networks: Read the output of a network as a scene: cameras and a dense cloud. Poses of another convention are
#   refused. Limits: MAX_CLOUD_POINTS, LOW_CONFIDENCE_FRACTION, MAX_EDGE_STEP, DEPTH_TOLERANCE, AGREEMENT_TOLERANCE,
#   MIN_AGREEMENT_GAIN, N_PAIRS, N_PAIR_POINTS, MAX_ASPECT_DIFFERENCE. Tests: test_networks.py.
# - photograph: Read one photograph with the depth map or the points of a network as a scene with one view. Tests:
#   test_photograph.py.
# - realitycapture: Read "Internal/External camera parameters" of RealityCapture, a CSV file, with points in a PLY file.
#   Limits: IMAGE_WIDTH_MM.
# - trajectory: Read a trajectory of SLAM in the format of TUM with a cloud of the same name (MASt3R-SLAM, VGGT-SLAM).
#   Limits: N_NUMBERS.
