"""Instance masks from files: COCO, label images, YOLO, labelme, arrays."""
