"""Which points and which masks show one thing (paper section 4.1)."""
