"""Naming: WordNet, matching, proofreading and the five levels."""
