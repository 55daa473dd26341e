"""Charts as SVG: distributions, scatter charts, size comparisons, icicle charts, and figures of the report."""
