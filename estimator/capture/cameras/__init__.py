"""The camera of a capture: what is known beforehand, which model fits, poses, whether the focal length holds."""
