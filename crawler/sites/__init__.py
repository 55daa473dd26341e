"""Declarations of sites: one TOML file per site."""
