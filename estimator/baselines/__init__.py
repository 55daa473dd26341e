"""Named baselines: what the paper and its predecessor did, for comparison in the same command."""
