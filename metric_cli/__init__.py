"""The three programs: parsers, tables on a terminal, progress, exit codes. Nothing below this package prints."""
