"""Instance masks from ONNX detectors of the user or of the registry."""

# Modules, their limits, and their tests in `tests/estimator/detectors`:
# - detect: Detect instances in the images of a scene. Tests: test_detector.py.
# - detector: Run an instance detector, an ONNX graph, on images: Mask R-CNN, or a one-stage detector (`one_stage`).
#   Limits: MAX_RUN_BYTES, MAX_IMAGE_S, MIN_SCORE, MIN_MASK_VALUE, CAFFE_MEANS, CAFFE_SHORT_SIDE, CAFFE_MAX_SIDE,
#   CAFFE_DIVISOR, MAX_BOX_DISTANCE, MAX_DETECTIONS, MAX_LABELS, MAX_LABEL_BYTES, MAX_GRAPH_BYTES, SCORE_TOLERANCE,
#   MAX_SIDE_PX. Tests: test_detector.py, test_one_stage.py.
# - one_stage: Interpret the outputs of one-stage detectors in ONNX: YOLO, RT-DETR and D-FINE, RF-DETR, RTMDet. Limits:
#   N_COCO_SLOTS, MIN_RTMDET_MASK, NMS_IOU, INPUT_SIDE_PX, PADDING_GREY, MAX_CANDIDATES, MAX_KEPT, MAX_NAMES_CHARS,
#   MAX_CLASSES. Tests: test_one_stage.py.
# - registry: Registry of open detectors (`data/detectors.toml`): names, addresses and checksums; downloads on request
#   only. Limits: SIZE_TIMEOUT_S. Tests: test_detector.py.
