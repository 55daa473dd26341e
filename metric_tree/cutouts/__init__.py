"""Foreground masks of pictures: one protocol, a backend without weights, one with a network, and what to trust."""
