"""Read reconstructions of other programs: nerfstudio, Bundler, Metashape, RealityCapture, Meshroom."""
