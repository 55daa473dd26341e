"""Subcommands of `metric-tree` from pages and open data sets to a release."""
