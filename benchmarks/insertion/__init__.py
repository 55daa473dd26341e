"""Figures of insertion."""
