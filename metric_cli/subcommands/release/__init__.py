"""Subcommands of `metric-tree` that query, compare, publish and serve releases."""
