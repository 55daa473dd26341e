"""`insert-object`."""
