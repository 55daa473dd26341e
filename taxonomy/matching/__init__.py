"""A source's words to a concept, and the reviewers' decisions about it."""
