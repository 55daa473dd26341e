"""Benchmarks of the build, the priors and the pictures."""
