"""Which points and which masks show one object (paper section 4.1)."""
