"""`estimate-scale`: its options, and its result on a terminal."""
