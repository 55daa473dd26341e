"""Read instance masks from files: COCO, label images, YOLO, labelme, arrays."""

# Modules, their limits, and their tests in `tests/estimator/instances`:
# - coco: Read instances in the formats of COCO: datasets (polygons, run lengths), results (a list), and panoptic
#   segmentation. Limits: MAX_BOX_EXTENT, MAX_EXCEEDING_FRACTION.
# - instance_reader: Find the instance masks of a scene, recognise their format, and read them; masks in memory are
#   accepted, too. Tests: test_damaged_files.py, test_forms.py, test_instances.py.
# - label_images: Read label images as OpenSfM stores them: `instances/<image>.png` and `instances/categories.json`.
#   Limits: MIN_PART_FRACTION, MAX_COMPARED, MAX_DIGITS.
# - labelme: Read labelme files: one JSON document per image, with labelled polygons, rectangles, circles and masks.
# - mask_arrays: Read mask files of Segment Anything: one file per image, with an optional JSON file of labels. Limits:
#   MAX_MASK_BYTES.
# - mask_decoding: Decode masks of COCO to arrays: polygons, run lengths as text or numbers, and boxes. Limits:
#   MAX_OUTLINE_PX. Tests: test_forms.py, test_instances.py.
# - view_matching: Match masks and image files to the views of a scene, by file name. Limits: MAX_MASKS,
#   MAX_SCENE_BYTES, MAX_ASPECT_DIFFERENCE, MAX_ACCEPTED_ASPECT_DIFFERENCE. Tests: test_damaged_files.py,
#   test_instances.py.
# - yolo: Read text files of YOLO: one file per image, one line per object, with coordinates relative to the image size.
#   Tests: test_damaged_files.py, test_forms.py.
