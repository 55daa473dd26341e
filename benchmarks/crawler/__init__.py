"""Benchmarks of crawling and of reading pages."""
