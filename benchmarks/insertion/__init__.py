"""Benchmarks of object insertion."""
