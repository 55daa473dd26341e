"""Blender in a process of its own: Cycles in place of the embedded renderer, and `.blend` files."""
