"""Servers for HTTP and the Model Context Protocol: the bytes of the static site, and queries that have no file."""
