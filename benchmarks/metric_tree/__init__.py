"""Benchmarks of releases and their priors."""
