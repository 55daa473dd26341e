"""Which view sees which point: by its own observations, by a cloud's lists, or by a depth buffer."""
