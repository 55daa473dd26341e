"""Reports on a release: summary, description, contact sheet and the difference of two releases."""
