"""The HTTP server and that of the Model Context Protocol: what cannot be a file, and the same bytes as the site."""
