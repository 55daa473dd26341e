"""Inputs of a capture: videos and image folders, the choice of frames, and the metadata of the lens."""
