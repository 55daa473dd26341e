"""Instance masks from ONNX detectors of the user or of the registry."""
