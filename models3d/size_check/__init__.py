"""3-D models: the size that a file states, whether it is true, and the true size (docs/explanation/model-sizes.md)."""
