"""Foreground masks of a release's images: one protocol, a backend without weights, one with a network."""
