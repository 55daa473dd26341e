"""`insert-object` and `insert-object study`."""
