"""Verbs of `metric-tree` that show, search, compare and pass on releases; one module each, as in `metric_cli.verbs`."""
