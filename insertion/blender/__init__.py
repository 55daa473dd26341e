"""Blender in a separate process: Cycles instead of the embedded renderer, and `.blend` files."""
