"""Ten videos from the file to the inserted object, and twins of real things, against the truth."""
