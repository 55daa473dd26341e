"""Verbs of `metric-tree` that bring raw items: from sites, saved pages and open data sets."""
