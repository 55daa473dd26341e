"""Measure objects in scene units, from their points and masks (paper section 4.2)."""
