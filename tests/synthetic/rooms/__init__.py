"""Synthetic furnished rooms and streets of known size: rendered, reconstructed and measured."""
