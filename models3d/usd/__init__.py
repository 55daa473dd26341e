"""Reader and writer of Universal Scene Description files."""

# Modules, their limits, and their tests in `tests/models3d`:
# - reader: Boxes of the objects in a USD file (usd-core); references to files outside its folder are refused. Limits:
#   MAX_BYTES, MAX_LAYERS, MAX_COMPOSED_PRIMS. Tests: test_limits.py, test_readers.py.
# - writer: Write meshes and materials of a model to a USD stage: `UsdGeomMesh`, `UsdPreviewSurface`, textures as PNG
#   files.
