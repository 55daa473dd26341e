"""A result in three dimensions: what is shown, as a glTF file, as a picture, and in a window."""
