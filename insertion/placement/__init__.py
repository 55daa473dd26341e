"""Placement of objects: positions, orientation, size and motion."""
