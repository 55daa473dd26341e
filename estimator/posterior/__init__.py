"""Measured objects and priors to a posterior over log scale (paper, section 4.3)."""
