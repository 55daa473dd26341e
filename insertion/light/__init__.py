"""The light of a scene: lamps of a room, sun and sky, and the environment map at a position."""
