"""Measured objects in scene units, from the points and masks of one object each (paper section 4.2)."""
