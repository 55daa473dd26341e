"""Benchmarks of the geometry, the posterior and the whole estimate."""
