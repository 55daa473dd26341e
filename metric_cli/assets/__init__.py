"""Verbs of `metric-tree` about 3-D models: their sizes, and pictures of them."""
