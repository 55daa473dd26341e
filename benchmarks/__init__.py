"""Benchmarks: speed, accuracy, growth. Each is a command; none is a test."""
