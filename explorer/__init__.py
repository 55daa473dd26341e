"""Metric-Tree in a browser and over HTTP: pages, JSON answers and tables of a release, as files or from a server.

`renderer` has the one function from a release and an address to bytes; `site` writes all of them as files, `server`
answers with the same bytes.
"""
