"""Furnished rooms and streets of exactly known size: rendered, reconstructed, and handed to the estimator."""
