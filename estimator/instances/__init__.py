"""Read instance masks from files: COCO, label images, YOLO, labelme, arrays."""
