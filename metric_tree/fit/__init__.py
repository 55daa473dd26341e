"""Rows of one class to a prior, and the priors of inner nodes."""
