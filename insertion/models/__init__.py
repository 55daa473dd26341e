"""Models to insert: glTF reading and the size in metres."""
