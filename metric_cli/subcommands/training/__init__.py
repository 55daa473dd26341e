"""Subcommands of `metric-tree` that make training data: foregrounds, selections and COCO sets."""
