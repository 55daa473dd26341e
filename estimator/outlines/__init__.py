"""Outlines of objects and the upright cuboids that fit them, for objects on which few points lie."""
