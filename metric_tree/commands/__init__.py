"""The `metric-tree` command: one module per verb."""
