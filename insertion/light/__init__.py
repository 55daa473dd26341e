"""The light of the scene at a place: an environment from the pictures, and directional lights drawn from it."""
