"""Raw items to a release, in five steps."""
