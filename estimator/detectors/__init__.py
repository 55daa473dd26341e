"""Detectors of the user: ONNX graphs run on the pictures of a scene, and the list of open ones."""
