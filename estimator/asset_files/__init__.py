"""Files of 3-D models: the bodies in them, and the same file written at another size."""
