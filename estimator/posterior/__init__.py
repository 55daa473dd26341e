"""Posterior of the scale from measured objects, size priors and other evidence (paper, section 4.3)."""
