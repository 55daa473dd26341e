"""Reconstructions of other programs: nerfstudio, Bundler, Metashape, RealityCapture, Meshroom."""
