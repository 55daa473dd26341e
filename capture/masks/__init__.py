"""Masks that a user draws on frames, and the instances file that they are written to."""
