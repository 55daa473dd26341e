"""Foreground masks of a release's pictures: one protocol, a backend without weights, one with a network."""
