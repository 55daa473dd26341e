"""Points and masks to measured objects in scene units (paper, sections 4.1 and 4.2)."""
