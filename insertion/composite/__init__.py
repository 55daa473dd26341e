"""Compositing of rendered objects: occlusion, shadows, camera look."""
