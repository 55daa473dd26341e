"""Web pages, JSON records and tables of a release, as static files or from an HTTP server.

`routes` is the table of all addresses. `static_site` writes their contents as files; `server` sends the same bytes.
"""
