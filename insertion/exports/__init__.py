"""The scene at metric scale for other programs: glTF, USD, Blender, COLMAP, nerfstudio."""
