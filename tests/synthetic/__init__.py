"""Synthetic data for tests and benchmarks: trees, scenes, rooms, web sites and damaged files."""
