"""Read reconstructions of COLMAP and OpenSfM and dense clouds as a `Scene`, and check them."""
