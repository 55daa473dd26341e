"""What all packages use: errors of the input, checked records, files and who may replace them, locks, statistics."""
