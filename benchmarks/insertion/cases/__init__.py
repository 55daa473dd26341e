"""Ten videos from the file to the inserted object, against the truth."""
