"""Foreground masks of the images of a release, by a backend without weights or by a network."""
