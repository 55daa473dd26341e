"""Every coded rule of a release (E1xx to W5xx)."""
