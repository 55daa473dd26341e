"""OpenGL on EGL: models under many lights through the recovered camera."""
