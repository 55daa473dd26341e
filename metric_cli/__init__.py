"""The three programs: parsers, tables, progress and exit statuses. Only this package writes to standard output."""
