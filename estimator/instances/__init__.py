"""Instance masks from COCO files, label images or a detector."""
