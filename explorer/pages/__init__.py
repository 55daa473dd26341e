"""HTML pages of a release, from Jinja2 templates; each function returns the text of one page."""
