"""Subcommands of `metric-tree` for 3-D models: size checks, true sizes and rendered images."""
