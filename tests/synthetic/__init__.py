"""Makers of test worlds: trees, scenes, rooms, sites, damaged files. Benchmarks import them too."""
