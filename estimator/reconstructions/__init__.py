"""COLMAP, OpenSfM and PLY files to a `Scene`, with the checks of each file."""
