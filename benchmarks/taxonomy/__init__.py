"""Benchmarks of levels, matching and label lists."""
