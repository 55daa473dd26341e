"""The scene of an insertion: point cloud, support surfaces, masks of every frame, scale."""
