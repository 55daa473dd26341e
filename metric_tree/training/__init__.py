"""Training data for instance segmentation: cut-outs pasted at sizes from the tree, and other sets."""
