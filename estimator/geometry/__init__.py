"""Measured objects in scene units, from the points and masks of one thing each (paper section 4.2)."""
