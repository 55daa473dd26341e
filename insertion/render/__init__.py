"""Rendering by OpenGL (EGL): models under many lights through the camera of a frame."""
