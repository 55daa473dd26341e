"""Projection of points into views, and the points that each view sees."""
