"""Files that an estimate writes: figure, overlays, and the scene at metric scale."""
