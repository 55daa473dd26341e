"""HTML pages of a release, from Jinja2 templates; one function per page."""
