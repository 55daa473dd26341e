"""3-D views of an estimate: their content, as a glTF file, as an image, and in a window."""
