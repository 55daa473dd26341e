"""Exports of the scene in metres for other programs: glTF, USD, Blender, COLMAP, nerfstudio."""
