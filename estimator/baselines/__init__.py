"""Baselines for comparison: the method of the paper, and that of Sucar and Hayet."""
